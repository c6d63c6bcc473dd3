#include "period.h"

/* What each format runs is made for it alone: a call and its registers cost more than the code. */
#define MADE_FOR_EACH static inline __attribute__((always_inline))

void tact_period_latch(tact_board *board, int32_t *codes)
{
    const int32_t slot = board->delay_at;
    tact_board_channel *channel = board->channel, *const end = channel + board->channels;
    for (; channel != end; channel++) {
        const int32_t out = channel->delayed[slot];
        channel->out_v = channel->delayed_v[slot];
        channel->out = out;
        *codes++ = (int32_t)((uint32_t)out << 8) >> 8;
    }
}

/* The stream's row for this tick, or NULL where there is none. */
static const float *stream_row(const tact_board *board)
{
    const uint32_t tick = board->tick;
    if (board->source != TACT_STREAM || tick - board->stream_at >= board->stream_end - board->stream_at)
        return NULL;
    return board->stream + (size_t)((tick & (board->stream_capacity - 1)) * (uint32_t)board->channels);
}

/* value within +/- most; NaN gives 0. What is within already costs one comparison. */
static inline float within(float value, float most)
{
    if (__builtin_fabsf(value) <= most)
        return value;
    return value > most ? most : value < -most ? -most : 0.0f;
}

/* Sections in a row. Only a silent input can bring them to rest. */
static inline float cascade(const tact_section *section, tact_section_state *state, int32_t count, float x)
{
    float value = x;
    if (x == 0.0f) {
        for (int32_t i = 0; i < count; i++)
            value = tact_section_step(&section[i], &state[i], value);
        return value;
    }
    for (int32_t i = 0; i < count; i++)
        value = tact_section_awake(&section[i], &state[i], value);
    return value;
}

/* Two sections of F and three of C, as `design` gives them: nothing to count. */
static inline float cascade_2_3(const tact_controller *table, tact_controller_state *state, float reference,
                                float position_v)
{
    const tact_section *f = table->prefilter, *c = table->feedback;
    tact_section_state *p = state->prefilter, *q = state->feedback;
    const float error = tact_section_awake(&f[1], &p[1], tact_section_awake(&f[0], &p[0], reference)) - position_v;
    return tact_section_awake(&c[2], &q[2], tact_section_awake(&c[1], &q[1], tact_section_awake(&c[0], &q[0], error)));
}

static float cascade_any(const tact_controller *table, tact_controller_state *state, float reference, float position_v)
{
    const float value = cascade(table->prefilter, state->prefilter, table->prefilter_count, reference);
    if (table->feedback_count == 0)
        return value;
    return cascade(table->feedback, state->feedback, table->feedback_count, value - position_v);
}

/* The nearest code of a command that the D/A can reach. */
static inline int32_t reachable_code(const tact_converter *converter, float command_v)
{
    const float steps = (command_v - converter->offset_v_single) * converter->motor_steps_per_v_single;
    return (int32_t)(steps + (steps < 0.0f ? -0.5f : 0.5f));
}

static inline int32_t number(const tact_board *board, const tact_board_channel *channel)
{
    return (int32_t)(channel - board->channel);
}

static void object(tact_board *board, tact_board_channel *channel)
{
    tact_board_fail(board, tact_guard_name(channel->safety, &channel->guard), number(board, channel));
}

/* The command into the queue; after the guard has spoken, since a cut leaves no authority. */
static inline void put(const tact_board *board, tact_board_channel *channel, int32_t slot, float command_v,
                       int32_t limited)
{
    const float allowed_v = board->authority * command_v;
    channel->delayed_v[slot] = allowed_v;
    channel->delayed[slot] = (reachable_code(&channel->safety->converter, allowed_v) & 0xffffff) | limited << 24;
}

typedef void (*runner)(tact_board *board, tact_board_channel *channel, float want, int32_t code);

/* The limits, where they act; 1 unless the controller's arithmetic is broken. */
static int limit_single(const tact_controller *table, tact_controller_state *state, float *command_v)
{
    const int32_t count = table->feedback_count;
    *command_v = tact_controller_limit(table, state, *command_v, count ? &state->feedback[count - 1] : NULL);
    return !state->broken;
}

MADE_FOR_EACH void run_float(tact_board *board, tact_board_channel *channel, float want, int32_t code, int32_t slot,
                             float fade, int usual)
{
    const tact_safety_channel *safety = channel->safety;
    const tact_controller *table = channel->single;
    tact_controller_state *state = &channel->controller.single;
    int objects, limited = 0;
    const float position_v = tact_guard_sense(safety, &channel->guard, code, channel->out_v, &objects);
    const float reference = fade * within(want, safety->reference_max);
    float command_v = usual && reference != 0.0f ? cascade_2_3(table, state, reference, position_v)
                                                 : cascade_any(table, state, reference, position_v);
    if (!(__builtin_fabsf(command_v) <= table->command_max_v)) {
        limited = 1;
        if (!limit_single(table, state, &command_v))
            tact_board_fail(board, 1u << TACT_FAULT_NOT_A_NUMBER, number(board, channel));
    }
    if (objects)
        object(board, channel);
    put(board, channel, slot, command_v, limited);
}

static void run_single(tact_board *board, tact_board_channel *channel, float want, int32_t code)
{
    run_float(board, channel, want, code, board->delay_at, board->fade, 0);
}

static void run_q31(tact_board *board, tact_board_channel *channel, float want, int32_t code)
{
    tact_controller_q31_state *state = &channel->controller.q31;
    const tact_safety_channel *safety = channel->safety;
    int objects;
    const float position_v = tact_guard_sense(safety, &channel->guard, code, channel->out_v, &objects);
    const float reference = board->fade * within(want, safety->reference_max);
    const float command_v = tact_controller_q31_step(channel->q31, state, reference, position_v);
    if (objects)
        object(board, channel);
    put(board, channel, board->delay_at, command_v, state->clamped);
}

static void run_direct(tact_board *board, tact_board_channel *channel, float want, int32_t code)
{
    const tact_safety_channel *safety = channel->safety;
    const float command_v = within(want, safety->command_max_v);
    int objects;
    (void)tact_guard_sense(safety, &channel->guard, code, channel->out_v, &objects);
    if (objects)
        object(board, channel);
    if (want - want != 0.0f)
        tact_board_fail(board, 1u << TACT_FAULT_NOT_A_NUMBER, number(board, channel));
    put(board, channel, board->delay_at, board->fade * command_v, command_v != want);
}

static void run_nothing(tact_board *board, tact_board_channel *channel, int32_t code)
{
    int objects;
    (void)tact_guard_sense(channel->safety, &channel->guard, code, channel->out_v, &objects);
    if (objects)
        object(board, channel);
    channel->delayed[board->delay_at] = channel->rest_code & 0xffffff;
    channel->delayed_v[board->delay_at] = 0.0f;
}

static void run_channels(tact_board *board, const int32_t *codes, const float *wants, runner run)
{
    const int32_t channels = board->channels;
    int32_t *trace = board->trace + (size_t)(board->tick & (board->trace_capacity - 1)) * 2u * (size_t)channels;
    tact_board_channel *channel = board->channel, *const end = channel + channels;
    for (; channel != end; channel++, trace++) {
        const int32_t code = *codes++;
        trace[0] = channel->out;
        trace[channels] = code;
        run(board, channel, *wants++, code);
    }
}

/* The same for what `design` gives, in one piece. */
static void run_channels_2_3(tact_board *board, const int32_t *codes, const float *wants)
{
    const float fade = board->fade;
    const int32_t slot = board->delay_at;
    const int32_t channels = board->channels;
    int32_t *trace = board->trace + (size_t)(board->tick & (board->trace_capacity - 1)) * 2u * (size_t)channels;
    tact_board_channel *channel = board->channel, *const end = channel + channels;
    for (; channel != end; channel++, trace++) {
        const int32_t code = *codes++;
        trace[0] = channel->out;
        trace[channels] = code;
        run_float(board, channel, *wants++, code, slot, fade, 1);
    }
}

static void step_running(tact_board *board, const int32_t *codes)
{
    float stimulus[TACT_CHANNELS_MAX];
    const float *wants = stream_row(board);
    if (!wants) {
        for (int32_t c = 0; c < board->channels; c++)
            stimulus[c] = board->source == TACT_STIMULUS ? tact_stimulus_next(&board->stimulus[c], board->tick) : 0.0f;
        wants = stimulus;
    }
    if (board->drives)
        run_channels(board, codes, wants, run_direct);
    else if (board->is_2_3)
        run_channels_2_3(board, codes, wants);
    else if (board->image.format == TACT_Q31)
        run_channels(board, codes, wants, run_q31);
    else
        run_channels(board, codes, wants, run_single);
    board->tick++;
    if (board->fading)
        tact_board_fade(board);
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

void tact_period_step(tact_board *board, const int32_t *codes, uint32_t lateness)
{
    if (board->safety.channels == 0)
        return;
    watch_time(board, lateness);
    if (board->mode == TACT_RUNNING || (board->mode == TACT_FAULT && board->authority > 0.0f)) {
        step_running(board, codes);
    } else {
        for (int32_t c = 0; c < board->channels; c++)
            run_nothing(board, &board->channel[c], codes[c]);
    }
    const float turns = board->safety.turns_single;
    for (int32_t c = board->turn; c < board->channels; c += board->safety.turns) {
        const uint32_t faults = tact_guard_compare(&board->safety.channel[c], &board->channel[c].guard, turns);
        if (faults)
            tact_board_fail(board, faults, c);
    }
    board->turn = board->turn + 1 < board->safety.turns ? board->turn + 1 : 0;
    board->delay_at = board->delay_at + 1 < board->safety.delay_samples ? board->delay_at + 1 : 0;
}
