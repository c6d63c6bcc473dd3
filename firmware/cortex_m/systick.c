#include "cortex_m/systick.h"

#include <stddef.h>

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define CONTROL REGISTER(0xE000E010u)
#define RELOAD REGISTER(0xE000E014u)
#define VALUE REGISTER(0xE000E018u)
#define PRIORITY (*(volatile uint8_t *)0xE000ED23u)
#define PENDING REGISTER(0xE000ED04u)

enum { PENDS_SYSTICK = 1 << 26 };
enum { ENABLED = 1, COUNTS = 5, RUNS = 7, WRAPPED = 1 << 16, LONGEST = 0xffffff };
enum { TIMER_PRIORITY = 0x80 }; /* what receives bytes is more urgent: a byte waits for 5 us only */

static void (*volatile the_tick)(void);
static volatile uint32_t runs, missed, lateness; /* runs: CONTROL while time goes on */

void tact_systick_start(uint32_t clocks, void (*tick)(void))
{
    CONTROL = 0;
    the_tick = tick;
    PRIORITY = TIMER_PRIORITY;
    RELOAD = clocks - 1u;
    VALUE = 0;
    runs = RUNS;
    CONTROL = RUNS;
}

void tact_systick(void)
{
    const uint32_t reload = RELOAD, value = VALUE; /* reads 0 at the wrap itself */
    (void)CONTROL; /* takes back the mark of the wrap that brought us here */
    lateness = (value == 0 ? 0 : reload - value) * 256u / (reload + 1u) + missed;
    the_tick();
    missed = CONTROL & WRAPPED ? 256u : 0u;
}

uint32_t tact_systick_lateness(void)
{
    return lateness;
}

void tact_systick_stand(void)
{
    CONTROL = runs & ~(uint32_t)ENABLED;
}

void tact_systick_go_on(void)
{
    CONTROL = runs;
}

void tact_systick_leap(void)
{
    VALUE = 0;
    PENDING = PENDS_SYSTICK;
    __asm volatile("dsb\n isb" ::: "memory");
}

int tact_systick_goes(void)
{
    return (CONTROL & ENABLED) != 0;
}

void tact_systick_count(void)
{
    CONTROL = 0;
    RELOAD = LONGEST;
    VALUE = 0;
    runs = COUNTS;
    CONTROL = COUNTS;
}

uint32_t tact_systick_left(void)
{
    return VALUE;
}

uint32_t tact_interrupts_enter(void)
{
    uint32_t before;
    __asm volatile("mrs %0, basepri\n msr basepri, %1" : "=&r"(before) : "r"(TIMER_PRIORITY) : "memory");
    return before;
}

void tact_interrupts_leave(uint32_t before)
{
    __asm volatile("msr basepri, %0" ::"r"(before) : "memory");
}

void tact_sleep(void)
{
    __asm volatile("wfi" ::: "memory");
}

/* An interrupt that is kept out ends the sleep all the same, and comes in after it. */
void tact_sleep_unless(int (*reason)(void))
{
    __asm volatile("cpsid i" ::: "memory");
    if (!reason())
        tact_sleep();
    __asm volatile("cpsie i" ::: "memory");
}
