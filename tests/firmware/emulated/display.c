#include "emulated/display.h"

#include "cortex_m/registers.h"
#include "display/finger_request.h"
#include "display/simulated_board.h"
#include "port.h"

#define CONTROL 0xE000E010u
#define VALUE 0xE000E018u
#define PENDING 0xE000ED04u

enum { ENABLED = 1, RUNS = 7, PENDS_SYSTICK = 1 << 26, COUNTER_MAX = 0xffffff };
enum { BEHIND_TICKS = 64, BEHIND_ROWS = 256 }; /* a host that is silent for longer, or has fed less ahead, is behind */
enum { FORCE_ROWS = TACT_STREAM_ROWS, FELT_ROWS = TACT_TRACE_ROWS };

#define BESIDE __attribute__((section(".beside")))

static const volatile tact_board *seen; /* as the interrupt changes it */
static tact_board *the_board;
static void (*the_tick)(void);
static int leaps;
static tact_simulated_board simulated BESIDE;
static float force[FORCE_ROWS * TACT_CHANNELS_MAX] BESIDE, felt_mm[FELT_ROWS * TACT_CHANNELS_MAX] BESIDE;

/* Cycles are counted anew from a touch on. */
static int32_t touched(void *context, uint8_t type, tact_reader *in)
{
    the_board->cycles = 0;
    return tact_simulated_board_touch(context, type, in);
}

void tact_emulated_begin(tact_board *board, tact_link *link)
{
    seen = the_board = board;
    tact_simulated_board_reset(&simulated, force, felt_mm);
    board->allows_hold = 1;
    tact_simulated_board_join(&simulated, link);
    link->display.request = touched;
}

/* -- time ------------------------------------------------------------------------------------------------------------ */

void tact_emulated_come(void)
{
    if (tact_emulated_holds()) {
        tact_port_feed_watchdog();
        return;
    }
    tact_emulated_go_on();
    the_tick();
    tact_emulated_stand();
    tact_simulated_board_advance(&simulated);
    if (!leaps)
        tact_emulated_go_on();
}

void tact_emulated_ticks(void (*tick)(void), int by_leaps)
{
    the_tick = tick;
    leaps = by_leaps;
}

int tact_emulated_holds(void)
{
    return !tact_simulated_board_goes_on(&simulated, the_board, 0);
}

int tact_emulated_leap(void)
{
    static uint32_t passed;
    if (!tact_simulated_board_goes_on(&simulated, the_board, passed)) {
        passed = 0;
        return 0;
    }
    if (tact_board_wants_tones(the_board))
        return 1; /* the main loop makes them first */
    passed++;
    tact_set(VALUE, 0);
    tact_set(PENDING, PENDS_SYSTICK);
    __asm volatile("dsb\n isb" ::: "memory");
    return 1;
}

void tact_emulated_stand(void)
{
    if (the_tick)
        tact_set(CONTROL, RUNS & ~ENABLED);
}

void tact_emulated_go_on(void)
{
    if (the_tick)
        tact_set(CONTROL, RUNS);
}

int tact_emulated_goes(void)
{
    return (tact_get(CONTROL) & ENABLED) != 0;
}

uint32_t tact_emulated_cycles(void)
{
    return COUNTER_MAX - tact_get(VALUE);
}

/* -- what stands in for the converters -------------------------------------------------------------------------------- */

void tact_emulated_put_out(const int32_t *codes)
{
    tact_emulated_stand();
    tact_simulated_board_press(&simulated, the_board);
    tact_simulated_board_latch(&simulated, codes);
    tact_emulated_go_on();
}

void tact_emulated_read_in(int32_t *codes)
{
    tact_emulated_stand();
    tact_simulated_board_read(&simulated, codes);
    tact_simulated_board_feel(&simulated, the_board);
    tact_emulated_go_on();
}

/* -- free runs -------------------------------------------------------------------------------------------------------- */

int tact_emulated_runs_freely(void)
{
    return seen->mode == TACT_RUNNING && !seen->holds;
}

int tact_emulated_is_behind(uint32_t part)
{
    const uint32_t ahead = seen->stream_end - seen->tick, silence = seen->silence;
    const int is_short = seen->source == TACT_STREAM && ahead != 0 && ahead < BEHIND_ROWS;
    if (!tact_emulated_runs_freely())
        return TACT_KEEPS_UP;
    return is_short && silence >= ahead / part ? TACT_FEEDS_LITTLE : silence > BEHIND_TICKS ? TACT_IS_SILENT : TACT_KEEPS_UP;
}
