#include "board/period.h"

#include "board/run.h"
#include "touch/adaptive_controller.h"

void tact_period_latch(const tact_board *board, int32_t *codes)
{
    for (int32_t c = 0; c < TACT_CHANNELS_MAX; c++)
        codes[c] = (int32_t)((uint32_t)board->channel[c].delayed[board->delay_at] << 8) >> 8;
}

/* The command into the queue, as the nearest code that the D/A can reach. */
static void put(tact_board_channel *channel, int32_t slot, float command_v, int limited)
{
    const float steps = (command_v - channel->to_code.first) * channel->to_code.second;
    channel->delayed_v[slot] = command_v;
    channel->delayed[slot] = tact_nearest(steps) ^ ((limited ? TACT_TRACE_COMMAND_LIMITED : 0) << 24);
}

static float command_of(tact_board_channel *channel, float reference, float position_v, int *limited)
{
    const tact_controller *table = channel->controller;
    tact_controller_state *state = &channel->controller_state;
    const float wanted_v = channel->touch->feedback_count
                               ? tact_adaptive_step(table, channel->touch, state, &channel->touch_state, reference, position_v)
                               : tact_controller_sections(table, state, reference, position_v);
    *limited = !(__builtin_fabsf(wanted_v) <= table->command_max_v);
    if (!*limited)
        return wanted_v;
    const float command_v = tact_controller_limit(table, state, reference, wanted_v);
    channel->broken = state->broken;
    return command_v;
}

static float command_of_drive(tact_board_channel *channel, float want, float fade, int *limited)
{
    const float command_v = tact_board_within(want, channel->safety->command_max_v);
    channel->broken = want - want != 0.0f;
    *limited = command_v != want;
    return fade * command_v;
}

/* One channel for one tick; 1 if its arithmetic broke. */
static int run_channel(const tact_board *board, tact_board_channel *channel, float want, float position_v)
{
    int limited;
    const float command_v = board->drives ? command_of_drive(channel, want, board->fade, &limited)
                            : command_of(channel, board->fade * want, position_v, &limited);
    put(channel, board->delay_at, board->command_fade * command_v, limited);
    if (channel->touch && channel->touch->feedback_count && !board->drives)
        tact_touch_put(channel->touch, &channel->touch_state, channel->delayed_v[board->delay_at]);
    return channel->broken;
}

static int run_channels(tact_board *board, const int32_t *codes, const float *wants)
{
    const int32_t slot = board->delay_at;
    int32_t *trace = board->trace + (size_t)((board->tick & (board->trace_capacity - 1)) * 2u * (uint32_t)board->channels);
    int found = 0;
    for (int32_t c = 0; c < board->channels; c++) {
        tact_board_channel *channel = &board->channel[c];
        *trace++ = channel->delayed[slot];
        *trace++ = codes[c];
        const float position_v = tact_guard_sense(&channel->guard_table, &channel->guard, codes[c],
                                                  channel->delayed_v[slot], board->ticks, &found);
        found |= run_channel(board, channel, wants[c], position_v);
    }
    return found;
}

static void step_running(tact_board *board, const int32_t *codes)
{
    float asked[TACT_CHANNELS_MAX];
    const float *wants = asked;
    if (board->tick - board->stream_at < board->stream_end - board->stream_at)
        wants = board->stream + (size_t)((board->tick & (board->stream_capacity - 1)) * (uint32_t)board->channels);
    else
        tact_board_ask(board, asked);
    if (run_channels(board, codes, wants))
        tact_board_see_to(board);
    if (board->cuts)
        tact_board_silence_cut(board);
    board->tick++;
    if (board->fading)
        tact_board_fade(board);
}

/* The guard watches; nothing is put out. */
static void step_resting(tact_board *board, const int32_t *codes)
{
    const int32_t slot = board->delay_at;
    int found = 0;
    for (int32_t c = 0; c < board->channels; c++) {
        tact_board_channel *channel = &board->channel[c];
        (void)tact_guard_sense(&channel->guard_table, &channel->guard, codes[c], channel->delayed_v[slot],
                               board->ticks, &found);
        channel->delayed[slot] = channel->rest_code;
        channel->delayed_v[slot] = 0.0f;
    }
    if (found)
        tact_board_see_to(board);
}

static void watch_time(tact_board *board, uint32_t lateness)
{
    board->ticks++;
    board->silence++;
    if (lateness > (uint32_t)board->safety.lateness_max) {
        board->late++;
        tact_board_fail(board, 1u << TACT_FAULT_LATE, -1);
    }
    if (board->silence > (uint32_t)board->safety.silence_ticks && board->mode == TACT_RUNNING)
        tact_board_fail(board, 1u << TACT_FAULT_SILENCE, -1);
}

/* The channels whose turn it is, watched beyond what each tick asks for. */
static void compare_in_turn(tact_board *board)
{
    for (int32_t c = board->turn; c < board->channels; c += board->turns) {
        tact_board_channel *channel = &board->channel[c];
        const int suspicion = tact_guard_look(&channel->guard_table, &channel->guard, board->ticks);
        const uint32_t faults =
            suspicion ? tact_guard_confirm(&channel->guard_table, &channel->guard, suspicion, board->ticks) : 0;
        if (faults)
            tact_board_fail(board, faults, c);
    }
    board->turn = board->turn + 1 < board->turns ? board->turn + 1 : 0;
}

void tact_period_step(tact_board *board, const int32_t *codes, uint32_t lateness)
{
    if (board->safety.channels == 0)
        return;
    watch_time(board, lateness);
    if (board->mode == TACT_RUNNING || (board->mode == TACT_FAULT && board->command_fade > 0.0f))
        step_running(board, codes);
    else
        step_resting(board, codes);
    compare_in_turn(board);
    board->delay_at = board->delay_at + 1 < board->safety.delay_samples ? board->delay_at + 1 : 0;
}
