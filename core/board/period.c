#include "board/period.h"

#include "board/run.h"

void tact_period_latch(const tact_board *board, int32_t *codes)
{
    for (int32_t c = 0; c < TACT_CHANNELS_MAX; c++)
        codes[c] = (int32_t)((uint32_t)board->channel[c].delayed[board->delay_at] << 8) >> 8;
}

/* The stream straight to the motor, within its limit; 1 where it was limited. */
static int drive(tact_board *board, int32_t c, float want, float *command_v)
{
    const float within_v = tact_board_within(want, board->safety.channel[c].command_max_v);
    board->channel[c].broken = want - want != 0.0f;
    *command_v = board->fade * within_v;
    return within_v != want;
}

static int control(tact_board *board, int32_t c, float want, float position_v, float *command_v)
{
    tact_controller_state *state = &board->channel[c].controller;
    *command_v = tact_controller_step(&board->image.controller[c], state, board->fade * want, position_v);
    if (state->clamped)
        board->channel[c].broken = state->broken;
    return state->clamped;
}

/* One channel for one tick; its command goes into the queue as the nearest code of the D/A. 1 if its arithmetic broke. */
static int run_channel(tact_board *board, int32_t c, float want, float position_v)
{
    const tact_converter *converter = &board->safety.channel[c].converter;
    tact_board_channel *channel = &board->channel[c];
    float answer_v;
    const int limited = board->drives ? drive(board, c, want, &answer_v) : control(board, c, want, position_v, &answer_v);
    const float command_v = board->command_fade * answer_v;
    const int32_t code = tact_nearest((command_v - converter->offset_v_single) * converter->motor_steps_per_v_single);
    channel->delayed_v[board->delay_at] = command_v;
    channel->delayed[board->delay_at] = (code & 0xffffff) | (limited ? TACT_TRACE_COMMAND_LIMITED << 24 : 0);
    if (!board->drives)
        tact_controller_put(&board->image.controller[c], &channel->controller, command_v);
    return limited && channel->broken;
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
        const float position_v = tact_guard_sense(&board->safety.channel[c], &channel->guard, codes[c],
                                                  channel->delayed_v[slot], board->ticks, &found);
        found |= run_channel(board, c, wants[c], position_v);
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
        (void)tact_guard_sense(&board->safety.channel[c], &channel->guard, codes[c], channel->delayed_v[slot],
                               board->ticks, &found);
        tact_board_put_rest(board, c, slot);
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
    const int32_t turns = board->safety.turns;
    for (int32_t c = board->turn; c < board->channels; c += turns) {
        const uint32_t faults = tact_guard_compare(&board->safety.channel[c], &board->channel[c].guard, turns, board->ticks);
        if (faults)
            tact_board_fail(board, faults, c);
    }
    board->turn = board->turn + 1 < turns ? board->turn + 1 : 0;
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
