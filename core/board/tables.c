#include "board/tables.h"

enum { OF_ALL = 2, OF_A_CHANNEL = 3, PARTS = OF_ALL + OF_A_CHANNEL * TACT_CHANNELS_MAX };

typedef struct {
    const uint32_t *words;
    uint32_t count;
} stretch;

static stretch between(const void *from, const void *to)
{
    const stretch found = {from, (uint32_t)((const uint8_t *)to - (const uint8_t *)from) / 4u};
    return found;
}

static stretch part_of(const tact_board *board, int32_t part)
{
    if (part == 0)
        return between(&board->safety, &board->safety + 1);
    if (part == 1)
        return between(&board->image, &board->image + 1);
    const tact_board_channel *channel = &board->channel[(part - OF_ALL) / OF_A_CHANNEL];
    switch ((part - OF_ALL) % OF_A_CHANNEL) {
    case 0:
        return between(&channel->guard_table, &channel->guard);
    case 1:
        return between(&channel->rest_code, &channel->rest_code + 1);
    default:
        return between(&channel->safety, channel + 1);
    }
}

static void add(tact_tables_sums *sums, const stretch *from, uint32_t word, uint32_t words)
{
    const uint32_t *at = from->words + word;
    uint32_t first = sums->first, second = sums->second;
    while (words--) {
        first += *at++;
        second += first;
    }
    sums->first = first;
    sums->second = second;
}

static void begin(tact_tables *tables)
{
    tables->part = 0;
    tables->word = 0;
    tables->sums.first = tables->sums.second = 1;
}

void tact_tables_learn(tact_tables *tables, const tact_board *board)
{
    begin(tables);
    for (int32_t part = 0; part < PARTS; part++) {
        const stretch all = part_of(board, part);
        add(&tables->sums, &all, 0, all.count);
    }
    tables->learnt = tables->sums;
    tables->taken = board->taken;
    begin(tables);
}

static int round_is_over(tact_tables *tables)
{
    const int same = tables->sums.first == tables->learnt.first && tables->sums.second == tables->learnt.second;
    begin(tables);
    return same;
}

int tact_tables_check(tact_tables *tables, const tact_board *board, uint32_t words)
{
    if (tables->taken != board->taken) {
        tact_tables_learn(tables, board);
        return 1;
    }
    while (words) {
        const stretch all = part_of(board, tables->part);
        const uint32_t left = all.count - tables->word, some = left < words ? left : words;
        add(&tables->sums, &all, tables->word, some);
        tables->word += some;
        words -= some;
        if (tables->word < all.count)
            continue;
        tables->word = 0;
        if (++tables->part == PARTS)
            return round_is_over(tables);
    }
    return 1;
}
