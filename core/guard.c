#include "guard.h"

#define COMPARE_WEIGHT 0.025f /* of a new product in the means: some 40 turns */
#define REVERSED_SHARE (-0.5f)

enum { SAME_TICKS_OF_A_FROZEN_ONE = 8 };

extern inline float tact_section_awake(const tact_section *section, tact_section_state *state, float x);
extern inline float tact_guard_sense(const tact_safety_channel *table, tact_guard_state *state, int32_t code,
                                     float motor_v, int *objects);

void tact_guard_reset(tact_guard_state *state)
{
    state->x = state->w = state->motor_before_v = state->felt = state->place = state->apart = 0.0f;
    state->agreement = state->power = 0.0f;
    state->last_code = state->compared_code = 0;
    state->same_ticks = 0;
    for (int i = 0; i < TACT_WEIGHTING_COUNT; i++)
        state->weighting[i].s1 = state->weighting[i].s2 = 0.0f;
}

static uint32_t stuck(const tact_guard_state *state)
{
    return 1u << (state->last_code < 2 && state->last_code > -2 ? TACT_FAULT_SENSOR_SHORTED : TACT_FAULT_SENSOR_FROZEN);
}

uint32_t tact_guard_name(const tact_safety_channel *table, const tact_guard_state *state)
{
    const int32_t code = state->last_code;
    uint32_t faults = 0;
    if (code > table->position_code_max || code < -table->position_code_max)
        return 1u << TACT_FAULT_SENSOR_OPEN;
    if (!(state->apart <= table->disagreement_v)) {
        if (state->same_ticks >= SAME_TICKS_OF_A_FROZEN_ONE)
            faults |= stuck(state);
        else
            faults |= 1u << ((float)code * state->x < 0.0f ? TACT_FAULT_SENSOR_REVERSED : TACT_FAULT_SENSOR_DISAGREES);
    }
    if (!(state->place <= table->stop_max_v))
        faults |= 1u << TACT_FAULT_TRAVEL;
    return faults;
}

static inline float weigh(const tact_section *section, tact_section_state *state, float y)
{
    if (y == 0.0f)
        return tact_section_step(&section[1], &state[1], tact_section_step(&section[0], &state[0], y));
    return tact_section_awake(&section[1], &state[1], tact_section_awake(&section[0], &state[0], y));
}

uint32_t tact_guard_compare(const tact_safety_channel *table, tact_guard_state *state, float turns)
{
    const int32_t code = state->last_code;
    const float moved_v = (float)(code - state->compared_code) * table->converter.step_v_single;
    const float model_v = turns * state->w;
    const float y = tact_converter_position_v(&table->converter, code);
    const float felt = weigh(table->weighting, state->weighting, y);
    const float agreement = state->agreement + COMPARE_WEIGHT * (model_v * moved_v - state->agreement);
    const float power = state->power + COMPARE_WEIGHT * (model_v * model_v - state->power);
    uint32_t faults = 0;
    state->compared_code = code;
    state->agreement = agreement;
    state->power = power;
    state->felt = felt;
    if (!(__builtin_fabsf(felt) <= table->comfort_max))
        faults |= 1u << TACT_FAULT_COMFORT;
    if (power > table->reversal_power && agreement < REVERSED_SHARE * power)
        faults |= 1u << TACT_FAULT_SENSOR_REVERSED;
    if (state->same_ticks >= table->frozen_ticks)
        faults |= stuck(state);
    return faults;
}
