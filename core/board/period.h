/* One period of a board: what happens in the timer interrupt, and nothing else does.
 *
 *     latch:  codes to the D/A
 *     step:   codes of the A/D --> guard --> reference, limited --> filters --> limits --> codes for a later latch
 *
 * The reference is limited to full comfort: through the designed H the felt reference is the reference itself, so no
 * reference passes comfort (docs/safety.md). docs/porting.md has its instructions.
 *
 * Example use:
 *   int32_t code[TACT_CHANNELS_MAX];
 *   tact_period_latch(&board, code);                put them out, read the A/D into code
 *   tact_period_step(&board, code, lateness);
 */
#ifndef TACT_PERIOD_H
#define TACT_PERIOD_H

#include <stdint.h>

#include "board/board.h"

/* Codes for the D/A from now on: TACT_CHANNELS_MAX of them. */
void tact_period_latch(const tact_board *board, int32_t *codes);

/* The readings of this instant; lateness of this interrupt, 1/256 of a period. */
void tact_period_step(tact_board *board, const int32_t *codes, uint32_t lateness);

#endif
