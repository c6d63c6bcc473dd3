#include "emulated/display.h"

#include "display/simulated_board.h"
#include "cortex_m/systick.h"

enum { BEHIND_TICKS = 64, BEHIND_ROWS = 256 }; /* a host that is silent for longer, or has fed less ahead, is behind */
enum { FORCE_ROWS = TACT_STREAM_ROWS, FELT_ROWS = TACT_TRACE_ROWS };

#define BESIDE __attribute__((section(".beside")))

static const volatile tact_board *seen; /* as the interrupt changes it */
static tact_board *the_board;
static tact_simulated_board simulated BESIDE;
static float force[FORCE_ROWS * TACT_CHANNELS_MAX] BESIDE, felt_mm[FELT_ROWS * TACT_CHANNELS_MAX] BESIDE;

void tact_emulated_begin(tact_board *board, tact_link *link)
{
    seen = the_board = board;
    tact_simulated_board_reset(&simulated, force, felt_mm);
    board->allows_hold = 1;
    tact_simulated_board_join(&simulated, link);
}

int tact_emulated_holds(void)
{
    const int rests = the_board->ending == TACT_STAYS && the_board->mode != TACT_RUNNING;
    return simulated.channels != the_board->channels || rests || tact_board_waits(the_board);
}

void tact_emulated_put_out(const int32_t *codes)
{
    tact_systick_stand();
    tact_simulated_board_press(&simulated, the_board);
    tact_simulated_board_latch(&simulated, codes);
    tact_systick_go_on();
}

void tact_emulated_read_in(int32_t *codes)
{
    tact_systick_stand();
    tact_simulated_board_read(&simulated, codes);
    tact_simulated_board_feel(&simulated, the_board);
    tact_systick_go_on();
}

void tact_emulated_finish(void)
{
    tact_systick_stand();
    tact_simulated_board_advance(&simulated);
    tact_systick_go_on();
}

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
