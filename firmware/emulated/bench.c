#include "emulated/bench.h"

#include "board/period.h"
#include "board/supervisor.h"
#include "cortex_m/systick.h"
#include "emulated/display.h"

enum { COUNTER_MAX = 0xffffff };

static tact_board *the_board;
static tact_supervisor supervisor; /* one of its own: the outputs are safe meanwhile */

void tact_emulated_bench_begin(tact_board *board)
{
    the_board = board;
}

static uint32_t since(uint32_t before)
{
    return (before - tact_systick_left()) & COUNTER_MAX;
}

static uint32_t count_period(uint32_t reading)
{
    int32_t codes[TACT_CHANNELS_MAX];
    tact_board_give_tones(the_board);
    uint32_t before = tact_systick_left();
    tact_period_latch(the_board, codes);
    uint32_t count = since(before) - reading;
    tact_emulated_put_out(codes);
    tact_emulated_read_in(codes);
    before = tact_systick_left();
    tact_period_step(the_board, codes, 0);
    (void)tact_supervisor_tick(&supervisor, the_board, 1);
    count += since(before) - reading;
    tact_emulated_finish();
    supervisor.deaf_ticks = 0;
    return count;
}

void tact_emulated_bench(uint32_t samples, uint32_t *counts)
{
    tact_systick_count();
    const uint32_t begun = tact_systick_left();
    const uint32_t reading = since(begun); /* what it takes to look at the timer */
    counts[0] = COUNTER_MAX;
    for (uint32_t k = 0; k < samples; k++) {
        const uint32_t count = count_period(reading);
        counts[0] = count < counts[0] ? count : counts[0];
        counts[1] = count > counts[1] ? count : counts[1];
        counts[2] += count;
    }
    tact_systick_stand();
}
