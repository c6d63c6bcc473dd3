/*
 * Soft starts and ends of a run. The reference and the command each have a factor between 0 and 1; both move by a step
 * at every tick, and what has come to its end leads to what follows.
 */
#ifndef TACT_FADE_H
#define TACT_FADE_H

#include "board/board.h"

/* A soft start begins: first of the command, then of the reference. */
void tact_board_fade_in(tact_board *board);

/* Fades move on by one tick. */
void tact_board_fade(tact_board *board);

#endif
