/* A controller that feeds forward for a finger: controller.h, or controller_q31.h, with feed_forward.h. One channel.
 *
 *     r ---> F ---+--->(+)---> C --->(+)---> command, to be limited
 *                 |     ^-            ^
 *                 |     y             | u_ff
 *                 +-----------> touch +
 *
 * The feed-forward is float32 in both formats: it is a small part of the command, whose round-off is not felt.
 *
 * Example use:
 *   float wanted_v = tact_adaptive_step(&table, &touch, &state, &touch_state, reference, position_v);
 *   float command_v = tact_controller_limit(&table, &state, reference, wanted_v);
 *   tact_touch_put(&touch, &touch_state, command_v);
 */
#ifndef TACT_ADAPTIVE_CONTROLLER_H
#define TACT_ADAPTIVE_CONTROLLER_H

#include "control/controller.h"
#include "control/controller_q31.h"
#include "touch/feed_forward.h"

/* One sample: reference (threshold units, finite) and position (volts, finite) in, the command before its limits out. */
inline float tact_adaptive_step(const tact_controller *table, const tact_touch *touch, tact_controller_state *state,
                                tact_touch_state *touch_state, float reference, float position_v)
{
    const float wanted_v = tact_sections_step(table->prefilter, state->prefilter, table->prefilter_count, reference);
    const float added_v = tact_touch_step(touch, touch_state, wanted_v, position_v);
    return tact_sections_step(table->feedback, state->feedback, table->feedback_count, wanted_v - position_v) + added_v;
}

/* The same in Q31, limited: volts of the command out. */
inline float tact_adaptive_q31_step(const tact_controller_q31 *table, const tact_touch *touch,
                                    tact_controller_q31_state *state, tact_touch_state *touch_state, float reference,
                                    float position_v)
{
    const int32_t asked = tact_q31_of(reference, TACT_Q31_PER_THRESHOLD);
    const int32_t position = tact_q31_of(position_v, TACT_Q31_PER_VOLT);
    int32_t value = asked;
    for (int32_t i = 0; i < table->prefilter_count; i++)
        value = tact_section_q31_step(&table->prefilter[i], &state->prefilter[i], value);
    const float added_v = tact_touch_step(touch, touch_state, (float)value * (1.0f / TACT_Q31_PER_VOLT), position_v);
    if (table->feedback_count)
        value = tact_q31_saturated((int64_t)value - position);
    for (int32_t i = 0; i < table->feedback_count; i++)
        value = tact_section_q31_step(&table->feedback[i], &state->feedback[i], value);
    const int32_t wanted = tact_q31_saturated((int64_t)value + tact_q31_of(added_v, TACT_Q31_PER_VOLT));
    return (float)tact_controller_q31_limit(table, state, asked, wanted) * (1.0f / TACT_Q31_PER_VOLT);
}

#endif
