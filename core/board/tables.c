#include "board/tables.h"

/* Safety table and image lie one behind the other at the board's end. */
static uint32_t words_of(const tact_board *board)
{
    return (uint32_t)((const uint8_t *)(board + 1) - (const uint8_t *)&board->safety) / 4u;
}

static void add(tact_tables *tables, const tact_board *board, uint32_t words)
{
    const uint32_t *at = (const uint32_t *)(const void *)&board->safety + tables->word;
    uint32_t first = tables->sums.first, second = tables->sums.second;
    tables->word += words;
    while (words--) {
        first += *at++;
        second += first;
    }
    tables->sums = (tact_tables_sums){first, second};
}

static void begin(tact_tables *tables)
{
    tables->word = 0;
    tables->sums = (tact_tables_sums){1, 1};
}

void tact_tables_learn(tact_tables *tables, const tact_board *board)
{
    begin(tables);
    add(tables, board, words_of(board));
    tables->learnt = tables->sums;
    tables->taken = board->taken;
    begin(tables);
}

int tact_tables_check(tact_tables *tables, const tact_board *board, uint32_t words)
{
    if (tables->taken != board->taken) {
        tact_tables_learn(tables, board);
        return 1;
    }
    const uint32_t left = words_of(board) - tables->word;
    add(tables, board, words < left ? words : left);
    if (words < left)
        return 1;
    const int same = tables->sums.first == tables->learnt.first && tables->sums.second == tables->learnt.second;
    begin(tables);
    return same;
}
