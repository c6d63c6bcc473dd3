/* Guard of one channel: what its sensor says is held against the plant, the travel and the skin, every tick.
 *
 *     m (motor, V) --> [ plant's model ] --> x, w          nu = y - x               |nu| > disagreement -> sensor, named
 *                            ^ correct                     |x' + lead w'| + |nu| > stop_max             -> travel
 *     code --> y ------------+---> [ weighting 1/H ] --> felt                       |felt| > comfort_max -> comfort
 *                                  (in turn)
 *
 * w is the velocity in volts of y per tick; x', w' are where the model will be a tick on, under the command that is out
 * now. Coasting with its own damping alone, the motor comes to rest `lead w'` further on. |nu| is added, so that the place of rest by the reading and that by the model are both within the limit:
 * a sensor that has just failed does not hide a motion, and a model that is wrong hides none either.
 * Corrected by nu with a bandwidth of some 20 Hz, the model follows slow forces of a finger and lighter or heavier
 * loads, and contradicts a sensor that does not follow the command.
 *
 * What needs no answer within the tick is looked at by tact_guard_compare(), for some of the channels each tick, in
 * turn: the felt reference, at a rate of at least four times the band's end (faster, no motor reaches comfort); a
 * reading that stays the same for frozen_ticks (frozen; at zero: shorted); and a reversed sensor on a loop that does
 * not run away, from the sign of the motion: mean of w dy against the mean of w^2, over some 30 ms.
 *
 * The compiler's own __builtin_fabsf is one instruction, and no call.
 *
 * Example use:
 *   int objects;
 *   float position_v = tact_guard_sense(&table->channel[c], &state, code, motor_v, &objects);
 *   if (objects) faults = tact_guard_name(&table->channel[c], &state);
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
    TACT_FAULT_SILENCE,
    TACT_FAULT_LAST = TACT_FAULT_SILENCE
} tact_fault;

typedef struct {
    float x, w;             /* the model's position and velocity */
    float motor_before_v;   /* in the period before this one */
    float place, apart;     /* of the last objection: predicted place of rest, and |nu|, by size */
    float felt;             /* felt reference */
    int32_t last_code, compared_code; /* of the last tick, and of the last comparison */
    int32_t same_ticks;
    float agreement, power; /* means of w dy and of w^2 */
    tact_section_state weighting[TACT_WEIGHTING_COUNT];
} tact_guard_state;

/* At rest at zero. */
void tact_guard_reset(tact_guard_state *state);

/* 1 << fault for each fault that the last reading shows; when tact_guard_sense() objects. */
uint32_t tact_guard_name(const tact_safety_channel *table, const tact_guard_state *state);

/* The slow part, for a channel whose turn it is, every so many ticks: 1 << fault for each fault found. */
uint32_t tact_guard_compare(const tact_safety_channel *table, tact_guard_state *state, float turns);

/* tact_section_step() of a section whose input is not silent: nothing comes to rest. */
inline float tact_section_awake(const tact_section *section, tact_section_state *state, float x)
{
    const float y = section->b0 * x + state->s1;
    state->s1 = state->s1 + ((section->b1 * x - section->a1 * y) + state->s2);
    state->s2 = state->s2 + (section->b2 * x - section->a2 * y);
    return y;
}

/* One reading, with the volts that the motor has from now on: gives y; objects where a limit is passed (NaN passes). */
inline float tact_guard_sense(const tact_safety_channel *table, tact_guard_state *state, int32_t code, float motor_v,
                              int *objects)
{
    const float y = tact_converter_position_v(&table->converter, code);
    const float x = state->x, w = state->w;
    const float nu = y - x, apart = __builtin_fabsf(nu);
    const float next = w + (table->drive * (motor_v + state->motor_before_v) -
                            (table->damp * w + table->spring * x - table->correct_w * nu));
    const int32_t before = state->last_code;
    const float moved = x + (next + table->correct_x * nu);
    const float place = __builtin_fabsf(moved + table->stop_lead * next) + apart;
    state->w = next;
    state->x = moved;
    state->motor_before_v = motor_v;
    state->last_code = code;
    state->same_ticks = code == before ? state->same_ticks + 1 : 0;
    *objects = !(place <= table->stop_max_v && apart <= table->disagreement_v);
    if (*objects) {
        state->place = place;
        state->apart = apart;
    }
    return y;
}

#endif
