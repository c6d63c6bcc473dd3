/* Tables in memory, checked in turn: a bit that has turned over is found before the tables have been gone through once.
 *
 *     safety | image       sums of 32-bit words
 *     --------> a stretch at a time, round and round
 *
 * What changes with every tick, and what lies in the rings, is no table. The sums are learnt when the board takes a table
 * or an image, which it does in OFF alone. They are Fletcher's: any word that differs changes the first, and words
 * that have changed places change the second.
 *
 * Example use, in the main loop:
 *   if (!tact_tables_check(&tables, &board, 64)) the tables are not what was taken;
 */
#ifndef TACT_TABLES_H
#define TACT_TABLES_H

#include <stdint.h>

#include "board/board.h"

typedef struct {
    uint32_t first, second;
} tact_tables_sums;

typedef struct {
    uint32_t taken; /* by the board, when the sums were learnt */
    uint32_t word;  /* that comes next */
    tact_tables_sums learnt, sums;
} tact_tables;

/* The tables as they are now are right. */
void tact_tables_learn(tact_tables *tables, const tact_board *board);

/* So many words more: 0 if a round has just come to other sums. Learns anew what the board has taken meanwhile. */
int tact_tables_check(tact_tables *tables, const tact_board *board, uint32_t words);

#endif
