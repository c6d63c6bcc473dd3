#include "controller_q31.h"

extern inline int32_t tact_q31_of(float value, float scale);
extern inline int32_t tact_controller_q31_limit(const tact_controller_q31 *table, tact_controller_q31_state *state,
                                                int32_t wanted, tact_section_q31_state *last);
extern inline float tact_controller_q31_step(const tact_controller_q31 *table, tact_controller_q31_state *state,
                                             float reference, float position_v);

void tact_controller_q31_reset(tact_controller_q31_state *state)
{
    for (int i = 0; i < TACT_PREFILTER_MAX; i++)
        state->prefilter[i].s1 = state->prefilter[i].s2 = 0;
    for (int i = 0; i < TACT_FEEDBACK_MAX; i++)
        state->feedback[i].s1 = state->feedback[i].s2 = 0;
    state->clamped = 0;
}

void tact_controller_q31_run(const tact_controller_q31 *table, tact_controller_q31_state *state,
                             const float *reference, const float *position_v, float *command_v, size_t samples)
{
    for (size_t k = 0; k < samples; k++)
        command_v[k] = tact_controller_q31_step(table, state, reference[k], position_v[k]);
}
