#include "board/board.h"

/* The slow part goes travel_share of the way to the reference each tick: that bounds the reference, too. */
float tact_board_limit(tact_board *board, int32_t channel, float want)
{
    const tact_safety_channel *safety = &board->safety.channel[channel];
    const float most = safety->travel_max, share = board->safety.travel_share, slow = board->channel[channel].slow;
    const float high = slow + (most - slow) / share, low = slow - (most + slow) / share;
    const float comfortable = tact_board_within(want, safety->reference_max);
    const float below = comfortable > high ? high : comfortable;
    const float limited = below < low ? low : below;
    board->channel[channel].slow = slow + share * (limited - slow);
    return limited;
}

static float take_reference(tact_board *board, int32_t c, float want)
{
    const tact_strength *strength = &board->image.strength[c];
    return tact_board_limit(board, c, strength->is_on ? tact_strength_step(strength, &board->channel[c].strength, want) : want);
}

static void take_row(tact_board *board, float *to, const float *row)
{
    for (int32_t c = 0; c < board->channels; c++)
        to[c] = board->drives ? row[c] : take_reference(board, c, row[c]);
}

uint32_t tact_board_stream(tact_board *board, uint32_t first, const float *rows, uint32_t count)
{
    const uint32_t width = (uint32_t)board->channels;
    if (board->mode != TACT_RUNNING || board->source == TACT_SILENT)
        return board->stream_end;
    if (board->tick - board->stream_end < 0x80000000u && first - board->tick < 0x40000000u)
        board->stream_at = board->stream_end = first; /* dry: a new stretch may begin now or later */
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t end = board->stream_end;
        if (first + i != end)
            continue;
        if (end - board->tick >= board->stream_capacity)
            break;
        float *to = board->stream + (size_t)((end & (board->stream_capacity - 1)) * width);
        take_row(board, to, rows + (size_t)(i * width));
        board->stream_end = end + 1;
    }
    return board->stream_end;
}

/* -- tones of the board's own ---------------------------------------------------------------------------------------- */

int tact_board_wants_tones(const tact_board *board)
{
    const uint32_t late = board->tick + TACT_TONES_AHEAD - board->tones_end;
    return board->mode == TACT_RUNNING && board->source == TACT_STIMULUS && late - 1u < 0x7fffffffu;
}

void tact_board_make_tones(tact_board *board, float *row)
{
    for (int32_t c = 0; c < board->channels; c++)
        row[c] = tact_stimulus_next(&board->stimulus[c], board->tones_end);
}

void tact_board_take_tones(tact_board *board, const float *row)
{
    float late[TACT_CHANNELS_MAX];
    const uint32_t at = board->tones_end++;
    if (at - board->tick < 0x80000000u)
        (void)tact_board_stream(board, at, row, 1);
    else
        take_row(board, late, row);
}

void tact_board_give_tones(tact_board *board)
{
    float row[TACT_CHANNELS_MAX];
    while (tact_board_wants_tones(board)) {
        tact_board_make_tones(board, row);
        tact_board_take_tones(board, row);
    }
}

void tact_board_ask(tact_board *board, float *wants)
{
    const int limits = board->source == TACT_STREAM && !board->drives;
    for (int32_t c = 0; c < board->channels; c++)
        wants[c] = limits ? tact_board_limit(board, c, 0.0f) : 0.0f;
}
