#include "board/guard.h"

#define REVERSED_SHARE (-0.5f)

enum { SAME_TICKS_OF_A_FROZEN_ONE = 8 };

static tact_float_pair pair(float first, float second)
{
    const tact_float_pair made = {first, second};
    return made;
}

void tact_guard_make(tact_guard_table *table, const tact_safety_channel *safety, int32_t turns)
{
    const float step_v = safety->converter.step_v_single, ticks = (float)turns;
    const float share = REVERSED_SHARE * ticks;
    const float power = safety->reversal_power / ((1.0f - TACT_GUARD_KEPT) * ticks * ticks);
    const float whole = 1.0f / (1.0f - safety->correct_x); /* nu, per volt that tact_guard_compare() finds */
    table->reading = pair(step_v, safety->drive);
    table->returning = pair(1.0f - safety->damp, safety->spring);
    table->correcting = pair(safety->correct_w, safety->correct_x);
    table->resting = pair(safety->stop_lead, safety->stop_max_v);
    table->differing = pair(0.5f * safety->disagreement_v, power);
    table->comparing = pair(safety->comfort_max, share * power);
    table->jumping = pair(safety->jump_share * ticks, safety->jump_v);
    table->staying = pair(1.0f - ticks * safety->damp, ticks * ticks * safety->spring);
    table->uncorrecting = pair(ticks * ticks * whole * (safety->correct_w + safety->damp * safety->correct_x), whole);
    table->still_codes = safety->still_codes;
    table->stray_max_v = safety->stray_max_v;
    table->reversed_share = share;
    for (int i = 0; i < TACT_WEIGHTING_COUNT; i++)
        table->weighting[i] = safety->weighting[i];
    table->frozen_ticks = safety->frozen_ticks < TACT_SAFETY_NEVER ? (uint32_t)safety->frozen_ticks : UINT32_MAX;
}

void tact_guard_reset(tact_guard_state *state, uint32_t tick)
{
    state->model = state->means = state->strayed = state->compared = pair(0.0f, 0.0f);
    state->before[0] = state->before[1] = pair(0.0f, 0.0f);
    state->balance = state->jump = state->felt = 0.0f;
    tact_guard_begin(state);
    state->motor_before_v = state->place = state->apart = 0.0f;
    state->last_code = state->violated = 0;
    state->changed_tick = tick;
    for (int i = 0; i < TACT_WEIGHTING_COUNT; i++)
        state->weighting[i].s1 = state->weighting[i].s2 = 0.0f;
}

void tact_guard_begin(tact_guard_state *state)
{
    state->lowest = INT32_MIN / 2; /* the next reading is beyond what stands still */
    state->highest = INT32_MAX / 2;
}

static uint32_t stuck(const tact_guard_state *state)
{
    return 1u << (state->last_code < 2 && state->last_code > -2 ? TACT_FAULT_SENSOR_SHORTED : TACT_FAULT_SENSOR_FROZEN);
}

uint32_t tact_guard_name(const tact_safety_channel *safety, const tact_guard_state *state, uint32_t tick)
{
    const int32_t code = state->last_code;
    uint32_t faults = 0;
    if (code > safety->position_code_max || code < -safety->position_code_max)
        return 1u << TACT_FAULT_SENSOR_OPEN;
    if (!(state->apart <= safety->disagreement_v)) {
        if (tick - state->changed_tick >= SAME_TICKS_OF_A_FROZEN_ONE)
            faults |= stuck(state);
        else
            faults |= 1u << ((float)code * state->model.first < 0.0f ? TACT_FAULT_SENSOR_REVERSED
                                                                     : TACT_FAULT_SENSOR_DISAGREES);
    }
    if (!(state->place <= safety->stop_max_v))
        faults |= 1u << TACT_FAULT_TRAVEL;
    return faults;
}

static inline int is_tiny(float value)
{
    return __builtin_fabsf(value) < TACT_TINY;
}

/* While the sensor reads zero: sections whose states have decayed come to rest, one after another. */
static void settle(tact_section_state *state)
{
    for (int i = 0; i < TACT_WEIGHTING_COUNT && is_tiny(state[i].s1) && is_tiny(state[i].s2); i++)
        state[i].s1 = state[i].s2 = 0.0f;
}

uint32_t tact_guard_confirm(const tact_guard_table *table, tact_guard_state *state, int suspicion, uint32_t tick)
{
    uint32_t faults = 0;
    if (state->last_code == 0)
        settle(state->weighting);
    if (!(__builtin_fabsf(state->felt) <= table->comparing.first))
        faults |= 1u << TACT_FAULT_COMFORT;
    if (state->means.second > table->differing.second &&
        state->means.first < table->reversed_share * state->means.second)
        faults |= 1u << TACT_FAULT_SENSOR_REVERSED;
    if (suspicion == TACT_STRAYS)
        faults |= 1u << TACT_FAULT_SENSOR_STUCK;
    if (!(state->jump <= table->jumping.second))
        faults |= 1u << TACT_FAULT_SENSOR_JUMPS;
    if (tick - state->changed_tick >= table->frozen_ticks)
        faults |= stuck(state);
    return faults;
}

uint32_t tact_guard_compare(const tact_guard_table *table, tact_guard_state *state, uint32_t tick)
{
    const int suspicion = tact_guard_look(table, state, tick);
    return suspicion ? tact_guard_confirm(table, state, suspicion, tick) : 0;
}
