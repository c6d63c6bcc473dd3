#include "board/period.h"

#include "board/run.h"
#include "touch/adaptive_controller.h"

/* What acts seldom stays out of the way of what every tick does: its calls would cost the others registers. */
#define SELDOM static __attribute__((noinline))
#define ALWAYS static inline __attribute__((always_inline))

/* The compiler reaches all of a channel from this one address, and computes no others. */
#define ONE_ADDRESS(pointer) __asm("" : "+r"(pointer))

/* tact_float_pair_get() reads at multiples of 8 bytes. */
#define AT_8(member) typedef char member##_is_not_at_a_multiple_of_8[offsetof(tact_board_channel, member) % 8 ? -1 : 1]
AT_8(controller);
AT_8(guard_table);
AT_8(guard);
AT_8(filters);
AT_8(to_code);

static inline int32_t code_of(const tact_board *board, int32_t channel, int32_t slot)
{
    return (int32_t)((uint32_t)board->channel[channel].delayed[slot] << 8) >> 8;
}

typedef char the_latch_has_a_line_for_each_channel[TACT_CHANNELS_MAX == 4 ? 1 : -1];

/* Of all channels that a board may have: to count those in use would cost more. */
void tact_period_latch(const tact_board *board, int32_t *codes)
{
    const int32_t slot = board->delay_at;
    codes[0] = code_of(board, 0, slot);
    codes[1] = code_of(board, 1, slot);
    codes[2] = code_of(board, 2, slot);
    codes[3] = code_of(board, 3, slot);
}

static int32_t *trace_row(const tact_board *board)
{
    return board->trace + (size_t)((board->tick & (board->trace_capacity - 1)) * 2u * (uint32_t)board->channels);
}

/* Two sections of F, three of C, the last of them b0 = 1 and integrating (a2 = 0): nothing to count, and
 * no product by 1 or 0. */
ALWAYS float cascade_designed(tact_controller_state *state, const float *k, float reference, float position_v,
                              float *wanted_v)
{
    tact_section_state *f = state->prefilter, *c = state->feedback;
    const tact_float_pair k0 = tact_float_pair_get(k), k1 = tact_float_pair_get(k + 2), k2 = tact_float_pair_get(k + 4);
    const float smooth = tact_section_awake(k0.first, k0.second, k1.first, k1.second, k2.first, &f[0], reference);
    const tact_float_pair k3 = tact_float_pair_get(k + 6), k4 = tact_float_pair_get(k + 8);
    const float wanted = tact_section_awake(k2.second, k3.first, k3.second, k4.first, k4.second, &f[1], smooth);
    *wanted_v = wanted;
    const float error = wanted - position_v;
    const tact_float_pair k5 = tact_float_pair_get(k + 10), k6 = tact_float_pair_get(k + 12), k7 = tact_float_pair_get(k + 14);
    const float lead = tact_section_awake(k5.first, k5.second, k6.first, k6.second, k7.first, &c[0], error);
    const tact_float_pair k8 = tact_float_pair_get(k + 16), k9 = tact_float_pair_get(k + 18);
    const float x = tact_section_awake(k7.second, k8.first, k8.second, k9.first, k9.second, &c[1], lead);
    const tact_float_pair s = tact_float_pair_get(&c[2]), k10 = tact_float_pair_get(k + 20);
    const float y = x + s.first;
    c[2].s1 = s.first + ((k10.first * x - k[22] * y) + s.second);
    c[2].s2 = s.second + k10.second * x;
    return reference == 0.0f ? tact_controller_rest(state, y, smooth, error, lead, x) : y;
}

/* The nearest code of a command that the D/A can reach. */
static inline int32_t reachable_code(const tact_float_pair *to_code, float command_v)
{
    const tact_float_pair to = tact_float_pair_get(to_code);
    return tact_nearest((command_v - to.first) * to.second);
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
    tact_controller_state *state = &channel->controller.single;
    const tact_touch *touch = channel->touch;
    const float reference = board->fade * want;
    const float command_v =
        touch->feedback_count == 0
            ? tact_controller_sections(table, state, reference, position_v)
            : tact_adaptive_step(table, touch, state, &channel->touch_state, reference, position_v);
    int found = 0;
    if (__builtin_fabsf(command_v) <= table->command_max_v)
        put(channel, board->delay_at, board->command_fade * command_v);
    else
        found = put_limited(board, channel, reference, command_v);
    if (touch->feedback_count)
        tact_touch_put(touch, &channel->touch_state, channel->delayed_v[board->delay_at]);
    return found;
}

static int run_q31(const tact_board *board, tact_board_channel *channel, float want, float position_v)
{
    tact_controller_q31_state *state = &channel->controller.q31;
    const tact_touch *touch = channel->touch;
    const float command_v =
        touch->feedback_count == 0
            ? tact_controller_q31_step(channel->q31, state, board->fade * want, position_v)
            : tact_adaptive_q31_step(channel->q31, touch, state, &channel->touch_state, board->fade * want, position_v);
    put_marked(channel, board->delay_at, board->command_fade * command_v, state->clamped);
    if (touch->feedback_count)
        tact_touch_put(touch, &channel->touch_state, channel->delayed_v[board->delay_at]);
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
ALWAYS int run_designed(tact_board *board, const int32_t *codes, const float *wants, uint32_t tick, int32_t slot,
                        float fade, float command_fade)
{
    int32_t *trace = trace_row(board), left = board->channels;
    tact_board_channel *channel = board->channel;
    int found = 0;
    do {
        const int32_t code = *codes++;
        *trace++ = channel->delayed[slot];
        *trace++ = code;
        const float position_v = tact_guard_sense(&channel->guard_table, &channel->guard, code,
                                                  channel->delayed_v[slot], tick, &found);
        const float reference = fade * *wants++;
        tact_controller_state *state = &channel->controller.single;
        float wanted_v;
        const float command_v = cascade_designed(state, channel->filters, reference, position_v, &wanted_v);
        if (__builtin_fabsf(command_v) <= channel->command_max_v)
            put(channel, slot, command_fade * command_v);
        else
            found |= put_limited(board, channel, reference, command_v);
        channel++;
    } while (--left != 0);
    return found;
}

/* Those that run all channels, for a tick whose fades are given. */
typedef int (*runner_of_all)(tact_board *board, const int32_t *codes, const float *wants, uint32_t tick, int32_t slot,
                             float fade, float command_fade);

/* The same for what `design` gives where a finger is fed forward: one sample of delay, so that `at` is 0. */
ALWAYS int run_adaptive(tact_board *board, const int32_t *codes, const float *wants, uint32_t tick, int32_t at,
                        float fade, float command_fade)
{
    int32_t *trace = trace_row(board), left = board->channels;
    tact_board_channel *channel = board->channel;
    int found = 0;
    do {
        const int32_t code = *codes++;
        *trace++ = channel->delayed[at];
        *trace++ = code;
        const float put_v = channel->delayed_v[at];
        const float position_v = tact_guard_sense(&channel->guard_table, &channel->guard, code, put_v, tick, &found);
        const float reference = fade * *wants++;
        tact_touch_state *touch_state = &channel->touch_state;
        float wanted_v;
        float command_v = cascade_designed(&channel->controller.single, channel->filters, reference, position_v, &wanted_v);
        command_v += tact_touch_designed_step(channel->touch, touch_state, wanted_v, position_v, put_v);
        if (__builtin_fabsf(command_v) <= channel->command_max_v)
            put(channel, at, command_fade * command_v);
        else
            found |= put_limited(board, channel, reference, command_v);
        touch_state->command_v[0] = channel->delayed_v[at];
        channel++;
    } while (--left != 0);
    return found;
}

SELDOM int run_fading(tact_board *board, const int32_t *codes, const float *wants)
{
    return run_designed(board, codes, wants, board->ticks, board->delay_at, board->fade, board->command_fade);
}

SELDOM int run_adaptive_fading(tact_board *board, const int32_t *codes, const float *wants)
{
    return run_adaptive(board, codes, wants, board->ticks, 0, board->fade, board->command_fade);
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
        tact_board_ask(board, asked);
    if (board->runs_designed)
        found = run_fading(board, codes, wants);
    else if (board->runs_adaptive)
        found = run_adaptive_fading(board, codes, wants);
    else
        found = run_channels(board, codes, wants,
                             board->drives                     ? run_direct
                             : board->image.format == TACT_Q31 ? run_q31
                                                               : run_single);
    if (found)
        tact_board_see_to(board);
    if (board->cuts)
        tact_board_silence_cut(board);
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
        tact_board_see_to(board);
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

SELDOM void confirm(tact_board *board, int32_t c, int suspicion)
{
    tact_board_channel *channel = &board->channel[c];
    const uint32_t faults = tact_guard_confirm(&channel->guard_table, &channel->guard, suspicion, board->ticks);
    if (faults)
        tact_board_fail(board, faults, c);
}

/* One channel, watched beyond what each tick asks for. */
static inline void compare(tact_board *board, int32_t c)
{
    tact_board_channel *channel = &board->channel[c];
    ONE_ADDRESS(channel);
    const int suspicion = tact_guard_look(&channel->guard_table, &channel->guard, board->ticks);
    if (suspicion)
        confirm(board, c, suspicion);
}

SELDOM void compare_from(tact_board *board, int32_t first)
{
    for (int32_t c = first; c < board->channels; c += board->turns)
        compare(board, c);
}

/* The channels whose turn it is: mostly one. */
static inline void compare_in_turn(tact_board *board)
{
    const int32_t turns = board->turns, channels = board->channels, turn = board->turn;
    if (turn < channels) {
        compare(board, turn);
        if (turn + turns < channels)
            compare_from(board, turn + turns);
    }
    board->turn = turn + 1 < turns ? turn + 1 : 0;
}

SELDOM void step_any(tact_board *board, const int32_t *codes, uint32_t lateness)
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

/* The fades that this asks for begin in the same tick, as they do in step_running(). */
SELDOM void see_to_steady(tact_board *board)
{
    tact_board_see_to(board);
    if (board->fading)
        tact_board_fade(board);
}

/* The usual tick goes a way of its own, without what it knows of: steady, in time, and there is a row for it. Gives 0 if
 * this is no such tick. */
ALWAYS int step_steady(tact_board *board, int32_t steady, const int32_t *codes, uint32_t lateness, runner_of_all run)
{
    const uint32_t tick = board->tick, ticks = board->ticks + 1, silence = board->silence + 1;
    const uint32_t latest = (uint32_t)board->safety.lateness_max, longest = (uint32_t)board->safety.silence_ticks;
    const uint32_t row = (tick & (board->stream_capacity - 1)) * (uint32_t)board->channels;
    if (!steady || tick - board->stream_at >= board->stream_end - board->stream_at || lateness > latest ||
        silence > longest)
        return 0;
    board->ticks = ticks;
    board->silence = silence;
    const int found = run(board, codes, board->stream + row, ticks, 0, 1.0f, 1.0f);
    board->tick++;
    if (found)
        see_to_steady(board);
    compare_in_turn(board);
    return 1;
}

SELDOM void step_adaptive(tact_board *board, const int32_t *codes, uint32_t lateness)
{
    if (!step_steady(board, 1, codes, lateness, run_adaptive))
        step_any(board, codes, lateness);
}

void tact_period_step(tact_board *board, const int32_t *codes, uint32_t lateness)
{
    if (step_steady(board, board->steady, codes, lateness, run_designed))
        return;
    if (board->steady_adaptive)
        step_adaptive(board, codes, lateness);
    else
        step_any(board, codes, lateness);
}
