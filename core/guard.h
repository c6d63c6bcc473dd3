/* Guard of one channel: what its sensor says is held against the plant, the travel and the skin, every tick.
 *
 *     m (motor, V) --> [ plant's model ] --> x, w          nu = y - x      |nu| > disagreement  -> sensor fault, named
 *                            ^ correct                     y, x + lead w + push m  > stop_max   -> travel
 *     code --> y ------------+---> [ weighting 1/H ] --> felt              |felt| > comfort_max -> comfort
 *          |code| > max -> open,    the same code for frozen_ticks -> frozen (at zero: shorted)
 *
 * w is the velocity in volts of y per tick. Coasting with its own damping alone, the motor comes to rest `lead w`
 * further on; both the reading and the model are asked, so that a sensor that has just failed does not hide a motion.
 * Corrected by nu with a bandwidth of some 20 Hz, the model follows slow forces of a finger and lighter or heavier
 * loads, and contradicts a sensor that does not follow the command.
 *
 * A reversed sensor on a loop that does not run away is found from the sign of the motion: mean of w dy against the
 * mean of w^2, over some 30 ms; tact_guard_compare() takes one channel a tick in turn.
 *
 * Example use:
 *   uint32_t faults = 0;
 *   float position_v = tact_guard_sense(&table->channel[c], &state, code, motor_v, &faults);
 */
#ifndef TACT_GUARD_H
#define TACT_GUARD_H

#include <stdint.h>

#include "safety.h"

typedef enum {
    TACT_FAULT_NONE = 0,
    TACT_FAULT_COMFORT,
    TACT_FAULT_TRAVEL,
    TACT_FAULT_SENSOR_OPEN,
    TACT_FAULT_SENSOR_SHORTED,
    TACT_FAULT_SENSOR_FROZEN,
    TACT_FAULT_SENSOR_REVERSED,
    TACT_FAULT_SENSOR_DISAGREES,
    TACT_FAULT_NOT_A_NUMBER,
    TACT_FAULT_LATE,
    TACT_FAULT_SILENCE
} tact_fault;

typedef struct {
    float x, w;           /* the model's position and velocity */
    float motor_before_v; /* in the period before this one */
    float felt;
    int32_t last_code;
    int32_t same_ticks;
    float moved_v;        /* reading less the reading before */
    float agreement, power; /* means of w dy and of w^2 */
    tact_section_state weighting[TACT_WEIGHTING_MAX];
} tact_guard_state;

/* At rest at zero. */
void tact_guard_reset(tact_guard_state *state);

/* Which sensor fault it is that contradicts the plant. */
int32_t tact_guard_name_of_disagreement(const tact_guard_state *state, float position_v);

/* Slow part, for one channel a tick; adds its faults. */
void tact_guard_compare(const tact_safety_channel *table, tact_guard_state *state, uint32_t *faults);

/* One reading, with the volts that the motor has from now on: gives y, adds 1 << fault for each fault found. */
inline float tact_guard_sense(const tact_safety_channel *table, tact_guard_state *state, int32_t code, float motor_v,
                              uint32_t *faults)
{
    const float y = tact_converter_position_v(&table->converter, code);
    const float x = state->x, w = state->w;
    const float nu = y - x;
    const float ahead = table->stop_lead * w + table->stop_push * motor_v;
    const float most = table->stop_max_v, apart = table->disagreement_v, comfort = table->comfort_max;
    const float by_sensor = y + ahead, by_model = x + ahead;
    float felt = y;
    for (int32_t i = 0; i < table->weighting_count; i++)
        felt = tact_section_step(&table->weighting[i], &state->weighting[i], felt);
    const float next = w + (table->drive * (motor_v + state->motor_before_v) -
                            (table->damp * w + table->spring * x - table->correct_w * nu));
    state->w = next;
    state->x = x + (next + table->correct_x * nu);
    state->motor_before_v = motor_v;
    state->felt = felt;
    state->moved_v = (float)(code - state->last_code);
    state->same_ticks = code == state->last_code ? state->same_ticks + 1 : 0;
    state->last_code = code;
    if (code > table->position_code_max || code < -table->position_code_max)
        *faults |= 1u << TACT_FAULT_SENSOR_OPEN;
    if (state->same_ticks >= table->frozen_ticks && table->frozen_ticks != 0)
        *faults |= 1u << (code < 2 && code > -2 ? TACT_FAULT_SENSOR_SHORTED : TACT_FAULT_SENSOR_FROZEN);
    if (!(felt <= comfort && felt >= -comfort))
        *faults |= 1u << TACT_FAULT_COMFORT;
    if (!(by_sensor <= most && by_sensor >= -most && by_model <= most && by_model >= -most))
        *faults |= 1u << TACT_FAULT_TRAVEL;
    if (!(nu <= apart && nu >= -apart))
        *faults |= 1u << tact_guard_name_of_disagreement(state, y);
    return y;
}

#endif
