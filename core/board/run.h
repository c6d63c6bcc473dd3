/*
 * A run of a board: its start, its fades, its end by a stop or a fault. The reference and the command each have a factor
 * between 0 and 1; both move by a step at every tick, and what has come to its end leads to what follows.
 *
 * Example use:
 *   tact_board_start(&board, run, TACT_STREAM, 0, 0);
 *   tact_board_stop(&board);                        the reference fades, then the command; ARMED follows
 */
#ifndef TACT_RUN_H
#define TACT_RUN_H

#include "board/board.h"

/* Transitions. 1: done, or done before; 0: not from this mode. */
int tact_board_start(tact_board *board, uint32_t run, int32_t source, int32_t drives, int32_t holds);
int tact_board_stop(tact_board *board);

/* Fades move on by one tick. */
void tact_board_fade(tact_board *board);

/* Faults found in a channel (-1: in none), 1 << fault for each: the run ends in the way that the gravest asks. */
void tact_board_fail(tact_board *board, uint32_t faults, int32_t channel);

/* What was found in the channels; once all commands are in the queue, since a cut empties it. */
void tact_board_see_to(tact_board *board);

/* What the filters of a cut channel have said is not heard. */
void tact_board_silence_cut(tact_board *board);

#endif
