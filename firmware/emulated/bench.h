/* What a period costs on an emulated board: counts of its timer, which under -icount are instructions, times a constant.
 *
 * Example use, in a port:
 *   link->bench = tact_emulated_bench;
 */
#ifndef TACT_EMULATED_BENCH_H
#define TACT_EMULATED_BENCH_H

#include <stdint.h>

#include "board/board.h"

/* The board whose periods are counted. */
void tact_emulated_bench_begin(tact_board *board);

/* Periods in the main loop, the timer free-running and silent: least, most and sum of what the board's part of each
 * takes, supervisor and all, the display's part left out. The timer stands still afterwards. As many samples as
 * before: what was counted then; 0 ends that. */
void tact_emulated_bench(uint32_t samples, uint32_t *counts);

#endif
