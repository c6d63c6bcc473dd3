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
 * when that command was given passes separate poles, whose contents both pushes are sums of.
 * u_ff beyond its design's bound sets everything here to zero.
 *
 * Example use, in each sample:
 *   float command_v = C's answer + tact_touch_step(&table, &state, C's sections, count, F's answer, position_v);
 *   tact_touch_put(&table, &state, command_v within its limits);
 */
#ifndef TACT_TOUCH_FEED_FORWARD_H
#define TACT_TOUCH_FEED_FORWARD_H

#include "touch/learning.h"

/* One sample through the poles: a command, the reading it acted on, and what the model's position was then. */
static inline void tact_touch_pass(const tact_touch *table, tact_touch_state *state, float command_v, float model_v,
                                   float position_v)
{
    const float corner = table->corner;
    float *const balance = state->balance, *const model = state->model;
    const float *const by_u = table->command, *const by_y = table->position;
    balance[2] += corner * (balance[1] - balance[2]) - by_y[0] * position_v;
    balance[1] += corner * (balance[0] - balance[1]) + (by_u[0] * command_v - by_y[1] * position_v);
    balance[0] += (by_u[1] * command_v - by_y[2] * position_v) - corner * balance[0];
    model[2] += corner * (model[1] - model[2]);
    model[1] += corner * (model[0] - model[1]);
    model[0] += corner * (model_v - model[0]);
}

/* The unloaded plant one sample on, with its command; gives u_ff. */
static inline float tact_touch_move(const tact_touch *table, tact_touch_state *state, float command_v)
{
    const float *const plant = table->plant;
    const float place = state->plant.s1, change = (plant[0] * command_v - plant[2] * place) + state->plant.s2;
    state->plant.s1 = place + change;
    state->plant.s2 += plant[1] * command_v - plant[3] * place;
    return state->by_command * command_v + (state->by_change * change + state->by_place * place);
}

/* One sample: C, F's answer and the position (volts, finite) in, what is to be added to the command (volts) out. */
static inline float tact_touch_step(const tact_touch *table, tact_touch_state *state, const tact_section *feedback,
                                    int32_t count, float wanted_v, float position_v)
{
    if (--state->left <= 0)
        tact_touch_learn(table, state);
    const int32_t at = state->at;
    const float model_v = state->model_v[at];
    tact_touch_pass(table, state, state->command_v[at], model_v, position_v);
    state->model_v[at] = state->plant.s1;
    const float command_v = tact_sections_step(feedback, state->feedback, count, wanted_v - model_v);
    const float added_v = tact_touch_move(table, state, command_v);
    if (__builtin_fabsf(added_v) <= table->push_max_v)
        return added_v;
    tact_touch_reset(table, state);
    return 0.0f;
}

/* The command that was put out in answer to this sample. */
static inline void tact_touch_put(const tact_touch *table, tact_touch_state *state, float command_v)
{
    state->command_v[state->at] = command_v;
    state->at = state->at + 1 < table->delay ? state->at + 1 : 0;
}

#endif
