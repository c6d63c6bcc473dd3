#include "board/period.h"

#include "board/fade.h"

/* What acts seldom stays out of the way of what every tick does: its calls would cost the others registers. */
#define SELDOM static __attribute__((noinline))

/* tact_float_pair_get() reads at multiples of 8 bytes. */
#define AT_8(member) typedef char member##_is_not_at_a_multiple_of_8[offsetof(tact_board_channel, member) % 8 ? -1 : 1]
AT_8(controller);
AT_8(guard_table);
AT_8(guard);
AT_8(filters);
AT_8(to_code);

void tact_period_latch(tact_board *board, int32_t *codes)
{
    const int32_t *out = board->channel->delayed + board->delay_at;
    for (int32_t left = board->channels; left > 0; left--) {
        *codes++ = (int32_t)((uint32_t)*out << 8) >> 8;
        out += sizeof *board->channel / sizeof *out;
    }
}

static int32_t *trace_row(const tact_board *board)
{
    return board->trace + (size_t)((board->tick & (board->trace_capacity - 1)) * 2u * (uint32_t)board->channels);
}

/* Sections in a row. Only a silent input can bring them to rest. */
static float cascade(const tact_section *section, tact_section_state *state, int32_t count, float x)
{
    float value = x;
    for (int32_t i = 0; i < count; i++)
        value = x == 0.0f ? tact_section_step(&section[i], &state[i], value)
                          : tact_section_awake(section[i].b0, section[i].b1, section[i].b2, section[i].a1,
                                               section[i].a2, &state[i], value);
    return value;
}

SELDOM float cascade_any(const tact_controller *table, tact_controller_state *state, float reference, float position_v)
{
    const float value = cascade(table->prefilter, state->prefilter, table->prefilter_count, reference);
    if (table->feedback_count == 0)
        return value;
    return cascade(table->feedback, state->feedback, table->feedback_count, value - position_v);
}

/* What a section that came by x == 0 does at last: section.h. */
static inline void rest(tact_section_state *state, float x)
{
    if (x == 0.0f && __builtin_fabsf(state->s1) < TACT_TINY && __builtin_fabsf(state->s2) < TACT_TINY)
        state->s1 = state->s2 = 0.0f;
}

/* After a silent reference; x: what went into F's second section and C's three. Gives y. */
SELDOM float rest_designed(tact_controller_state *state, float y, float smooth, float error, float lead, float x)
{
    rest(&state->prefilter[0], 0.0f);
    rest(&state->prefilter[1], smooth);
    if (error != 0.0f)
        return y;
    rest(&state->feedback[0], error);
    rest(&state->feedback[1], lead);
    rest(&state->feedback[2], x);
    return y;
}

/* Two sections of F, three of C, the last of them b0 = 1 and integrating (a2 = 0): nothing to count, and
 * no product by 1 or 0. */
static inline float cascade_designed(tact_controller_state *state, const float *k, float reference, float position_v)
{
    tact_section_state *f = state->prefilter, *c = state->feedback;
    const tact_float_pair k0 = tact_float_pair_get(k), k1 = tact_float_pair_get(k + 2), k2 = tact_float_pair_get(k + 4);
    const float smooth = tact_section_awake(k0.first, k0.second, k1.first, k1.second, k2.first, &f[0], reference);
    const tact_float_pair k3 = tact_float_pair_get(k + 6), k4 = tact_float_pair_get(k + 8);
    const float wanted = tact_section_awake(k2.second, k3.first, k3.second, k4.first, k4.second, &f[1], smooth);
    const float error = wanted - position_v;
    const tact_float_pair k5 = tact_float_pair_get(k + 10), k6 = tact_float_pair_get(k + 12), k7 = tact_float_pair_get(k + 14);
    const float lead = tact_section_awake(k5.first, k5.second, k6.first, k6.second, k7.first, &c[0], error);
    const tact_float_pair k8 = tact_float_pair_get(k + 16), k9 = tact_float_pair_get(k + 18);
    const float x = tact_section_awake(k7.second, k8.first, k8.second, k9.first, k9.second, &c[1], lead);
    const tact_float_pair s = tact_float_pair_get(&c[2]), k10 = tact_float_pair_get(k + 20);
    const float y = x + s.first;
    c[2].s1 = s.first + ((k10.first * x - k[22] * y) + s.second);
    c[2].s2 = s.second + k10.second * x;
    return reference == 0.0f ? rest_designed(state, y, smooth, error, lead, x) : y;
}

/* The nearest code of a command that the D/A can reach. */
static inline int32_t reachable_code(const tact_float_pair *to_code, float command_v)
{
    const tact_float_pair to = tact_float_pair_get(to_code);
    const float steps = (command_v - to.first) * to.second;
    return (int32_t)(steps + __builtin_copysignf(0.5f, steps));
}

/* The command into the queue. */
static inline void put(tact_board_channel *channel, int32_t slot, float command_v)
{
    channel->delayed_v[slot] = command_v;
    channel->delayed[slot] = reachable_code(&channel->to_code, command_v);
}

static inline void put_marked(tact_board_channel *channel, int32_t slot, float command_v, int32_t limited)
{
    put(channel, slot, command_v);
    channel->delayed[slot] ^= (limited ? TACT_TRACE_COMMAND_LIMITED : 0) << 24;
}

/* A command of the sections that is beyond its limits, limited; 1 if that is because the arithmetic is broken. */
SELDOM int put_limited(const tact_board *board, tact_board_channel *channel, float reference, float command_v)
{
    const tact_controller *table = channel->single;
    tact_controller_state *state = &channel->controller.single;
    const float limited_v = tact_controller_limit(table, state, reference, command_v);
    put_marked(channel, board->delay_at, board->command_fade * limited_v, 1);
    channel->broken = state->broken;
    return state->broken;
}

/* Each of these runs one channel for one tick; 1 if there is something to see to. */
typedef int (*runner)(const tact_board *board, tact_board_channel *channel, float want, float position_v);

static int run_single(const tact_board *board, tact_board_channel *channel, float want, float position_v)
{
    const tact_controller *table = channel->single;
    const float reference = board->fade * want;
    const float command_v = cascade_any(table, &channel->controller.single, reference, position_v);
    if (!(__builtin_fabsf(command_v) <= table->command_max_v))
        return put_limited(board, channel, reference, command_v);
    put(channel, board->delay_at, board->command_fade * command_v);
    return 0;
}

static int run_q31(const tact_board *board, tact_board_channel *channel, float want, float position_v)
{
    tact_controller_q31_state *state = &channel->controller.q31;
    const float command_v = tact_controller_q31_step(channel->q31, state, board->fade * want, position_v);
    put_marked(channel, board->delay_at, board->command_fade * command_v, state->clamped);
    return 0;
}

static int run_direct(const tact_board *board, tact_board_channel *channel, float want, float position_v)
{
    const float command_v = tact_board_within(want, channel->safety->command_max_v);
    (void)position_v;
    put_marked(channel, board->delay_at, board->command_fade * (board->fade * command_v), command_v != want);
    channel->broken = want - want != 0.0f;
    return channel->broken;
}

/* What was found in the channels; once all commands are in the queue, since a cut empties it. */
SELDOM void see_to(tact_board *board)
{
    for (int32_t c = 0; c < board->channels; c++) {
        tact_board_channel *channel = &board->channel[c];
        const int32_t broken = channel->broken, violated = channel->guard.violated;
        channel->broken = channel->guard.violated = 0;
        if (broken)
            tact_board_fail(board, 1u << TACT_FAULT_NOT_A_NUMBER, c);
        if (violated)
            tact_board_fail(board, tact_guard_name(channel->safety, &channel->guard, board->ticks), c);
    }
}

/* What the filters of a cut channel have said is not heard. */
SELDOM void silence_cut(tact_board *board)
{
    for (int32_t c = 0; c < board->channels; c++) {
        tact_board_channel *channel = &board->channel[c];
        if (channel->is_cut) {
            channel->delayed[board->delay_at] = channel->rest_code;
            channel->delayed_v[board->delay_at] = 0.0f;
        }
    }
}

SELDOM int run_channels(tact_board *board, const int32_t *codes, const float *wants, runner run)
{
    const int32_t channels = board->channels, slot = board->delay_at;
    int32_t *trace = trace_row(board);
    int found = 0;
    for (int32_t c = 0; c < channels; c++) {
        tact_board_channel *channel = &board->channel[c];
        *trace++ = channel->delayed[slot];
        *trace++ = codes[c];
        const float position_v = tact_guard_sense(&channel->guard_table, &channel->guard, codes[c],
                                                  channel->delayed_v[slot], board->ticks, &found);
        found |= run(board, channel, wants[c], position_v);
    }
    return found;
}

/* The same for what `design` gives, in one piece. */
static inline int run_designed(tact_board *board, const int32_t *codes, const float *wants)
{
    const float fade = board->fade, command_fade = board->command_fade;
    const uint32_t tick = board->ticks;
    const int32_t slot = board->delay_at, channels = board->channels;
    tact_board_channel *channel = board->channel, *const end = channel + channels;
    int32_t *trace = trace_row(board);
    int found = 0;
    for (; channel != end; channel++, trace += 2) {
        const int32_t code = *codes++;
        trace[0] = channel->delayed[slot];
        trace[1] = code;
        const float position_v = tact_guard_sense(&channel->guard_table, &channel->guard, code,
                                                  channel->delayed_v[slot], tick, &found);
        const float reference = fade * *wants++;
        tact_controller_state *state = &channel->controller.single;
        const float command_v = cascade_designed(state, channel->filters, reference, position_v);
        if (__builtin_fabsf(command_v) <= channel->command_max_v)
            put(channel, slot, command_fade * command_v);
        else
            found |= put_limited(board, channel, reference, command_v);
    }
    return found;
}

/* Nothing is asked for in this tick. */
SELDOM void ask(tact_board *board, float *wants)
{
    const int limits = board->source == TACT_STREAM && !board->drives;
    for (int32_t c = 0; c < board->channels; c++)
        wants[c] = limits ? tact_board_limit(&board->safety, c, &board->channel[c], 0.0f) : 0.0f;
}

static inline void step_running(tact_board *board, const int32_t *codes)
{
    float asked[TACT_CHANNELS_MAX];
    const float *wants = asked;
    const uint32_t tick = board->tick;
    int found;
    if (tick - board->stream_at < board->stream_end - board->stream_at)
        wants = board->stream + (size_t)((tick & (board->stream_capacity - 1)) * (uint32_t)board->channels);
    else
        ask(board, asked);
    if (board->runs_designed)
        found = run_designed(board, codes, wants);
    else
        found = run_channels(board, codes, wants,
                             board->drives                     ? run_direct
                             : board->image.format == TACT_Q31 ? run_q31
                                                               : run_single);
    if (found)
        see_to(board);
    if (board->cuts)
        silence_cut(board);
    board->tick++;
    if (board->fading)
        tact_board_fade(board);
}

/* The guard watches; nothing is put out. */
SELDOM void step_resting(tact_board *board, const int32_t *codes)
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
        see_to(board);
}

static inline void watch_time(tact_board *board, uint32_t lateness)
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
    if (board->mode == TACT_RUNNING || (board->mode == TACT_FAULT && board->command_fade > 0.0f))
        step_running(board, codes);
    else
        step_resting(board, codes);
    const int32_t turns = board->safety.turns, channels = board->channels, turn = board->turn;
    for (int32_t c = turn; c < channels; c += turns) {
        tact_board_channel *channel = &board->channel[c];
        const uint32_t faults = tact_guard_compare(&channel->guard_table, &channel->guard, board->ticks);
        if (faults)
            tact_board_fail(board, faults, c);
    }
    board->turn = turn + 1 < turns ? turn + 1 : 0;
    board->delay_at = board->delay_at + 1 < board->safety.delay_samples ? board->delay_at + 1 : 0;
}
