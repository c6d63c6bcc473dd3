#include "guard.h"

#define COMPARE_WEIGHT 0.025f /* of a new product in the means: some 40 turns */
#define REVERSED_SHARE (-0.5f)

enum { SAME_TICKS_OF_A_FROZEN_ONE = 8 };

extern inline float tact_guard_sense(const tact_safety_channel *table, tact_guard_state *state, int32_t code,
                                     float motor_v, uint32_t *faults);

void tact_guard_reset(tact_guard_state *state)
{
    state->x = state->w = state->motor_before_v = state->felt = state->moved_v = 0.0f;
    state->agreement = state->power = 0.0f;
    state->last_code = 0;
    state->same_ticks = 0;
    for (int i = 0; i < TACT_WEIGHTING_MAX; i++)
        state->weighting[i].s1 = state->weighting[i].s2 = 0.0f;
}

int32_t tact_guard_name_of_disagreement(const tact_guard_state *state, float position_v)
{
    if (state->same_ticks >= SAME_TICKS_OF_A_FROZEN_ONE)
        return state->last_code < 2 && state->last_code > -2 ? TACT_FAULT_SENSOR_SHORTED : TACT_FAULT_SENSOR_FROZEN;
    return position_v * state->x < 0.0f ? TACT_FAULT_SENSOR_REVERSED : TACT_FAULT_SENSOR_DISAGREES;
}

void tact_guard_compare(const tact_safety_channel *table, tact_guard_state *state, uint32_t *faults)
{
    const float moved_v = state->moved_v * table->converter.step_v_single;
    const float w = state->w;
    state->agreement += COMPARE_WEIGHT * (w * moved_v - state->agreement);
    state->power += COMPARE_WEIGHT * (w * w - state->power);
    if (table->reversal_power > 0.0f && state->power > table->reversal_power &&
        state->agreement < REVERSED_SHARE * state->power)
        *faults |= 1u << TACT_FAULT_SENSOR_REVERSED;
}
