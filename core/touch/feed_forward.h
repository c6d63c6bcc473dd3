/* Feed-forward for a finger, one channel: what is felt stays that of the unloaded display.
 *
 *     v --->(+)--> C --> ud --> plant --+--> yd      the unloaded loop, computed beside the real one
 *            ^-                         |
 *            +-------[ delay ]----------+
 *
 *     pushes: mass yd'' / B, (damping yd' + stiffness yd) / B      of the designed finger, in volts of command
 *     u_ff = weight[0] * first push + weight[1] * second push     added to the command, ahead of its limits
 *          = by_command * ud + by_change * (yd's change in a sample) + by_place * yd
 *
 * With A0 y = B u - Z y the loaded display answers as the unloaded one when u_ff = Z yd / B: the loop itself is never
 * touched, so that no weight can make it unstable. The pushes are those of the time when the command acts, since the
 * model knows yd as far ahead as its command is late.
 *
 * The weights are learnt (learning.h), from two sets of three poles each, which every sample passes: the finger's force is
 * the command less the position through the plant's inverse, summed before its poles; the position that the model had
 * when that command was given passes poles of its own, whose contents both pushes are sums of.
 * u_ff beyond its design's bound sets everything here to zero.
 *
 * Example use, in each sample:
 *   float command_v = C's answer + tact_touch_step(&table, &state, F's answer, position_v);
 *   tact_touch_put(&table, &state, command_v within its limits);
 */
#ifndef TACT_TOUCH_FEED_FORWARD_H
#define TACT_TOUCH_FEED_FORWARD_H

#include "touch/learning.h"

/* One sample through the poles: a command, the reading it acted on, and what the model's position was then. */
static inline void tact_touch_pass(const tact_touch *table, tact_touch_state *state, float command_v, float model_v,
                            float position_v)
{
    const tact_float_pair k0 = tact_float_pair_get(&table->corner), k1 = tact_float_pair_get(&table->command[1]);
    const tact_float_pair k2 = tact_float_pair_get(&table->position[1]);
    const tact_float_pair p0 = tact_float_pair_get(state->balance), p1 = tact_float_pair_get(&state->balance[2]);
    const tact_float_pair p2 = tact_float_pair_get(&state->model[1]);
    const float corner = k0.first;
    state->balance[2] = p1.first + (corner * (p0.second - p1.first) - k1.second * position_v);
    state->balance[1] = p0.second + (corner * (p0.first - p0.second) + (k0.second * command_v - k2.first * position_v));
    state->balance[0] = p0.first + ((k1.first * command_v - k2.second * position_v) - corner * p0.first);
    state->model[2] = p2.second + corner * (p2.first - p2.second);
    state->model[1] = p2.first + corner * (p1.second - p2.first);
    state->model[0] = p1.second + corner * (model_v - p1.second);
}

/* The unloaded plant one sample on, with its command; gives u_ff. */
static inline float tact_touch_move(const tact_touch *table, tact_touch_state *state, float command_v)
{
    const tact_float_pair b = tact_float_pair_get(table->plant), a = tact_float_pair_get(&table->plant[2]);
    const tact_float_pair s = tact_float_pair_get(&state->plant), by = tact_float_pair_get(&state->by_command);
    const float change = (b.first * command_v - a.first * s.first) + s.second;
    state->plant.s1 = s.first + change;
    state->plant.s2 = s.second + (b.second * command_v - a.second * s.first);
    return by.first * command_v + (by.second * change + state->by_place * s.first);
}

/* u_ff, if it is within its bound. */
static inline float tact_touch_bounded(const tact_touch *table, tact_touch_state *state, float added_v)
{
    if (__builtin_fabsf(added_v) <= table->push_max_v)
        return added_v;
    tact_touch_reset(table, state);
    return 0.0f;
}

/* One sample: F's answer and the position (volts, finite) in, what is to be added to the command (volts) out. */
float tact_touch_step(const tact_touch *table, tact_touch_state *state, float wanted_v, float position_v);

/* The command that was put out in answer to this sample. */
static inline void tact_touch_put(const tact_touch *table, tact_touch_state *state, float command_v)
{
    state->command_v[state->at] = command_v;
    state->at = state->at + 1 < table->delay ? state->at + 1 : 0;
}

#endif
