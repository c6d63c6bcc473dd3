#include "touch/feed_forward.h"

#include "arithmetic/finite.h"

extern inline void tact_touch_pass(float corner, tact_touch_poles *poles, float x);
extern inline float tact_touch_section(const tact_section *section, tact_section_state *state, float x);
extern inline void tact_touch_push(const tact_touch *table, tact_touch_state *state, float wanted_v, float *push_v);
extern inline float tact_touch_step(const tact_touch *table, tact_touch_state *state, float wanted_v, float position_v);
extern inline void tact_touch_put(const tact_touch *table, tact_touch_state *state, float command_v);

void tact_touch_run(const tact_touch *table, tact_touch_state *state, const float *wanted_v, const float *position_v,
                    const float *command_v, float *added_v, size_t samples)
{
    for (size_t k = 0; k < samples; k++) {
        added_v[k] = tact_touch_step(table, state, tact_finite(wanted_v[k], 1e6f), position_v[k]);
        tact_touch_put(table, state, command_v[k]);
    }
}
