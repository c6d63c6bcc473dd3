/* A controller that feeds forward for a finger: controller.h with feed_forward.h. One channel.
 *
 *     r ---> F ---+--->(+)---> C --->(+)---> command, to be limited
 *                 |     ^-            ^
 *                 |     y             | u_ff
 *                 +-----------> touch +
 *
 * Example use:
 *   float wanted_v = tact_adaptive_step(&table, &touch, &state, &touch_state, reference, position_v);
 *   float command_v = tact_controller_limit(&table, &state, reference, wanted_v);
 *   tact_touch_put(&touch, &touch_state, command_v);
 */
#ifndef TACT_ADAPTIVE_CONTROLLER_H
#define TACT_ADAPTIVE_CONTROLLER_H

#include "control/controller.h"
#include "touch/feed_forward.h"

/* One sample: reference (threshold units, finite) and position (volts, finite) in, the command before its limits out. */
static inline float tact_adaptive_step(const tact_controller *table, const tact_touch *touch, tact_controller_state *state,
                                tact_touch_state *touch_state, float reference, float position_v)
{
    const float wanted_v = tact_sections_step(table->prefilter, state->prefilter, table->prefilter_count, reference);
    const float added_v = tact_touch_step(touch, touch_state, wanted_v, position_v);
    return tact_sections_step(table->feedback, state->feedback, table->feedback_count, wanted_v - position_v) + added_v;
}

#endif
