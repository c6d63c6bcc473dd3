#include "board/guard.h"

#define KEPT 0.975f /* of a mean from one turn to the next: some 40 turns */
#define REVERSED_SHARE (-0.5f)

enum { SAME_TICKS_OF_A_FROZEN_ONE = 8 };

void tact_guard_reset(tact_guard_state *state, uint32_t tick)
{
    *state = (tact_guard_state){.changed_tick = tick};
    tact_guard_begin(state);
}

void tact_guard_begin(tact_guard_state *state)
{
    state->lowest = INT32_MIN / 2; /* the next reading is beyond any constant one */
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
    if (!(state->off <= safety->disagreement_v)) {
        if (tick - state->changed_tick >= SAME_TICKS_OF_A_FROZEN_ONE)
            faults |= stuck(state);
        else
            faults |= 1u << ((float)code * state->x < 0.0f ? TACT_FAULT_SENSOR_REVERSED : TACT_FAULT_SENSOR_DISAGREES);
    }
    if (!(state->place <= safety->stop_max_v))
        faults |= 1u << TACT_FAULT_TRAVEL;
    return faults;
}

/* How far the motor would have come if the constant reading were a lie: the observer's place, less all that
 * the reading has corrected it by since then, but for what it was corrected by when that began. Gives 1 where that is
 * too far. */
static int strays(const tact_safety_channel *safety, tact_guard_state *state, float ticks, float unexplained)
{
    const int32_t code = state->last_code;
    state->lowest = code < state->lowest ? code : state->lowest;
    state->highest = code > state->highest ? code : state->highest;
    if (state->highest - state->lowest > safety->still_codes) {
        state->lowest = state->highest = code;
        state->balance = unexplained;
        state->strayed = state->straying = 0.0f;
        return 0;
    }
    const float nu = (unexplained - state->balance) / (1.0f - safety->correct_x);
    const float braked = safety->damp * state->straying + safety->spring * state->strayed;
    state->straying -= ticks * (braked + (safety->correct_w + safety->damp * safety->correct_x) * nu);
    state->strayed += ticks * state->straying;
    return !(__builtin_fabsf(state->strayed - nu) <= safety->stray_max_v);
}

/* Motion against the model's, by the means of both: a sensor that is reversed. */
static int is_reversed(const tact_safety_channel *safety, tact_guard_state *state, float expected_v, float moved_v)
{
    state->agreement = KEPT * state->agreement + (1.0f - KEPT) * (expected_v * moved_v);
    state->power = KEPT * state->power + (1.0f - KEPT) * (expected_v * expected_v);
    return state->power > safety->reversal_power && state->agreement < REVERSED_SHARE * state->power;
}

/* The change of the unexplained motion from two turns ago, less the share that the model's own change may have in it. */
static int jumps(const tact_safety_channel *safety, tact_guard_state *state, float ticks, float apart)
{
    const float share = safety->jump_share * ticks;
    const float jump = __builtin_fabsf(apart - state->apart[1]) - share * __builtin_fabsf(state->w - state->moving[1]);
    state->apart[1] = state->apart[0];
    state->moving[1] = state->moving[0];
    state->apart[0] = apart;
    state->moving[0] = state->w;
    return !(jump <= safety->jump_v);
}

uint32_t tact_guard_compare(const tact_safety_channel *safety, tact_guard_state *state, int32_t turns, uint32_t tick)
{
    const float ticks = (float)turns, y = tact_converter_position_v(&safety->converter, state->last_code);
    const float felt = tact_sections_step(safety->weighting, state->weighting, TACT_WEIGHTING_COUNT, y);
    const float unexplained = (y + state->w) - state->x;
    uint32_t faults = 0;
    if (!(__builtin_fabsf(felt) <= safety->comfort_max))
        faults |= 1u << TACT_FAULT_COMFORT;
    if (is_reversed(safety, state, ticks * state->w, y - state->compared_v))
        faults |= 1u << TACT_FAULT_SENSOR_REVERSED;
    if (strays(safety, state, ticks, unexplained))
        faults |= 1u << TACT_FAULT_SENSOR_STUCK;
    if (jumps(safety, state, ticks, unexplained - state->unexplained))
        faults |= 1u << TACT_FAULT_SENSOR_JUMPS;
    if (tick - state->changed_tick >= (uint32_t)safety->frozen_ticks && safety->frozen_ticks < TACT_SAFETY_NEVER)
        faults |= stuck(state);
    state->compared_v = y;
    state->unexplained = unexplained;
    return faults;
}
