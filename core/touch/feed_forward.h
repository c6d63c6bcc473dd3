/* Feed-forward for a finger, one channel: what is felt stays that of the unloaded display. float32, in both formats.
 *
 *     v --->(+)--> C --> ud --> plant --+--> yd      the unloaded loop, computed beside the real one
 *            ^-                         |
 *            +-------[ delay ]----------+
 *
 *     pushes: mass yd'' / B, (damping yd' + stiffness yd) / B      of the designed finger, in volts of command
 *     u_ff = weight[0] * first push + weight[1] * second push     added to the command, ahead of its limits
 *
 * With A0 y = B u - Z y the loaded display answers as the unloaded one when u_ff = Z yd / B: the loop itself is never
 * touched, so that no weight can make it unstable. The pushes are those of the time when the command acts, since the
 * model knows yd as far ahead as its command is late.
 *
 * The weights are learnt (learning.h).
 * u_ff beyond its design's bound sets everything here to zero.
 *
 * Example use, in each sample:
 *   float command_v = C's answer + tact_touch_step(&table, &state, F's answer, position_v);
 *   tact_touch_put(&table, &state, command_v within its limits);
 */
#ifndef TACT_TOUCH_FEED_FORWARD_H
#define TACT_TOUCH_FEED_FORWARD_H

#include <stddef.h>

#include "touch/learning.h"

/* One sample through three poles. */
inline void tact_touch_pass(float corner, tact_touch_poles *poles, float x)
{
    poles->past[2] += corner * (poles->past[1] - poles->past[2]);
    poles->past[1] += corner * (poles->past[0] - poles->past[1]);
    poles->past[0] += corner * (x - poles->past[0]);
}

/* A section whose input is not silent: silence is seen to when learning. */
inline float tact_touch_section(const tact_section *section, tact_section_state *state, float x)
{
    const float y = section->b0 * x + state->s1;
    state->s1 += (section->b1 * x - section->a1 * y) + state->s2;
    state->s2 += section->b2 * x - section->a2 * y;
    return y;
}

/* The unloaded loop one sample on, with F's answer; gives the two pushes. */
inline void tact_touch_push(const tact_touch *table, tact_touch_state *state, float wanted_v, float *push_v)
{
    float model_v = wanted_v - state->model_v[state->at];
    for (int32_t i = 0; i < table->feedback_count; i++)
        model_v = tact_touch_section(&table->feedback[i], &state->feedback[i], model_v);
    tact_section_state *plant = &state->plant;
    const float from = plant->s1;
    plant->s1 = from + ((table->plant[0] * model_v - table->plant[2] * from) + plant->s2);
    plant->s2 += table->plant[1] * model_v - table->plant[3] * from;
    const float speed = table->per_sample * (plant->s1 - from), place = 0.5f * (plant->s1 + from);
    push_v[0] = table->mass * (model_v - (table->drag * speed + table->spring * place));
    push_v[1] = table->damping * speed + table->stiffness * place;
    state->model_v[state->at] = from;
}

/* One sample: F's answer and the position (volts, finite) in, what is to be added to the command (volts) out. */
inline float tact_touch_step(const tact_touch *table, tact_touch_state *state, float wanted_v, float position_v)
{
    const int32_t at = state->at;
    float push_v[2];
    if (++state->count >= table->turns)
        tact_touch_learn(table, state);
    tact_touch_pass(table->corner, &state->command, state->command_v[at]);
    tact_touch_pass(table->corner, &state->position, position_v);
    tact_touch_pass(table->corner, &state->push[0], state->pushed_v[0][at]);
    tact_touch_pass(table->corner, &state->push[1], state->pushed_v[1][at]);
    tact_touch_push(table, state, wanted_v, push_v);
    state->pushed_v[0][at] = push_v[0];
    state->pushed_v[1][at] = push_v[1];
    const float added_v = state->weight[0] * push_v[0] + state->weight[1] * push_v[1];
    if (__builtin_fabsf(added_v) <= table->push_max_v)
        return added_v;
    tact_touch_reset(table, state);
    return 0.0f;
}

/* The command that was put out in answer to this sample. */
inline void tact_touch_put(const tact_touch *table, tact_touch_state *state, float command_v)
{
    state->command_v[state->at] = command_v;
    state->at = state->at + 1 < table->delay ? state->at + 1 : 0;
}

/* samples of one channel, for tests: F's answers, positions and commands put out in, what is fed forward out. */
void tact_touch_run(const tact_touch *table, tact_touch_state *state, const float *wanted_v, const float *position_v,
                    const float *command_v, float *added_v, size_t samples);

#endif
