#define _POSIX_C_SOURCE 200809L
#include "host/parking.h"

#include <signal.h>
#include <stddef.h>

#ifdef _WIN32
#include <windows.h>
#define OF_THE_THREAD __declspec(thread)
typedef void (*Answer)(int);
static void rest(void) { Sleep(INFINITE); }
#else
#include <unistd.h>
#define OF_THE_THREAD __thread
typedef struct sigaction Answer;
static void rest(void) { pause(); }
#endif

static OF_THE_THREAD volatile int *mark; /* set when this thread is parked; NULL: it is not to be */
static Answer before;                    /* what answered an abort before */

static void put_back(void)
{
#ifdef _WIN32
    signal(SIGABRT, before);
#else
    sigaction(SIGABRT, &before, NULL);
#endif
}

static void park(int number)
{
    if (mark) {
        *mark = 1;
        for (;;)
            rest();
    }
    put_back(); /* another thread's abort ends the program */
    raise(number);
}

void tact_parking_begin(int *parked)
{
    mark = parked;
#ifdef _WIN32
    before = signal(SIGABRT, park);
#else
    Answer mine = {0};
    mine.sa_handler = park;
    sigemptyset(&mine.sa_mask);
    sigaction(SIGABRT, &mine, &before);
#endif
}

void tact_parking_end(void)
{
    put_back();
    mark = NULL;
}

int tact_parking_taken(const int *parked)
{
    return *(const volatile int *)parked;
}
