#include "emulated/bench.h"

#include "board/period.h"
#include "board/supervisor.h"
#include "cortex_m/systick.h"
#include "emulated/display.h"

enum { COUNTER_MAX = 0xffffff };

typedef struct {
    uint32_t samples, least, most, sum;
} tact_counted;

static tact_board *the_board;
static tact_counted counted;
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

static void count_periods(uint32_t samples)
{
    tact_systick_count();
    const uint32_t begun = tact_systick_left();
    const uint32_t reading = since(begun); /* what it takes to look at the timer */
    counted = (tact_counted){samples, COUNTER_MAX, 0, 0};
    for (uint32_t k = 0; k < samples; k++) {
        const uint32_t count = count_period(reading);
        counted.least = count < counted.least ? count : counted.least;
        counted.most = count > counted.most ? count : counted.most;
        counted.sum += count;
    }
    tact_systick_stand();
}

/* The same number again is the same request, whose answer was lost: nothing is counted anew. Zero ends what was. */
void tact_emulated_bench(uint32_t samples, uint32_t *counts)
{
    if (samples == 0)
        counted = (tact_counted){0, 0, 0, 0};
    else if (samples != counted.samples)
        count_periods(samples);
    counts[0] = counted.least;
    counts[1] = counted.most;
    counts[2] = counted.sum;
}
