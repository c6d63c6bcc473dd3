/* Guard of one channel: what its sensor says is held against the plant, the travel and the skin, every tick.
 *
 *     m (motor, V) --> [ plant's model ] --> x, w          nu = y - x               |nu| > disagreement -> sensor, named
 *                            ^ correct                     |p| or |p + nu| > stop_max, p = x' + lead w' -> travel
 *     code --> y ------------+---> [ weighting 1/H ] --> felt                       |felt| > comfort_max -> comfort
 *                                  (in turn)
 *
 * w is the velocity in volts of y per tick; x', w' are where the model will be a tick on, under the command that is out
 * now. Coasting with its own damping alone, the motor comes to rest `lead w'` further on: at p by the model, at p + nu by
 * the reading. Both are to be within the limit: a sensor that has just failed does not hide a motion, and a model that
 * is wrong hides none either. The greater of the two is |p + nu / 2| + |nu / 2|.
 * Corrected by nu with a bandwidth of some 20 Hz, the model follows slow forces of a finger and lighter or heavier
 * loads, and contradicts a sensor that does not follow the command.
 *
 * What needs no answer within the tick is looked at by tact_guard_compare(), for some of the channels each tick, in
 * turn: the felt reference, at a rate of at least four times the band's end (faster, no motor reaches comfort); a
 * reading that stays the same for frozen_ticks (frozen; at zero: shorted); a reversed sensor on a loop that does not run
 * away, from the sign of the motion: mean of w dy against the mean of w^2, over some 30 ms; a reading that jumps, more
 * than any force makes it; and one that is constant, but for noise, while the command asks for motion (stuck). Under a
 * steady finger a reading is constant as well, and the loop's integrator holds the finger's force: so it is motion by
 * the command's change since then that counts.
 *
 * The compiler's own __builtin_fabsf is one instruction, and no call.
 *
 * Example use:
 *   int violated = 0;
 *   float position_v = tact_guard_sense(&safety->channel[c], &state, code, motor_v, tick, &violated);
 *   if (violated) faults = tact_guard_name(&safety->channel[c], &state, tick);
 */
#ifndef TACT_GUARD_H
#define TACT_GUARD_H

#include <stdint.h>

#include "arithmetic/section.h"
#include "board/safety.h"

typedef enum {
    TACT_FAULT_NONE = 0,
    TACT_FAULT_COMFORT,
    TACT_FAULT_TRAVEL,
    TACT_FAULT_SENSOR_OPEN,
    TACT_FAULT_SENSOR_SHORTED,
    TACT_FAULT_SENSOR_FROZEN,
    TACT_FAULT_SENSOR_REVERSED,
    TACT_FAULT_SENSOR_DISAGREES,
    TACT_FAULT_SENSOR_STUCK,
    TACT_FAULT_SENSOR_JUMPS,
    TACT_FAULT_NOT_A_NUMBER,
    TACT_FAULT_LATE,
    TACT_FAULT_SILENCE,
    TACT_FAULT_LAST = TACT_FAULT_SILENCE
} tact_fault;

typedef struct {
    float x, w;              /* the model's position and velocity, a tick */
    float motor_before_v;    /* in the period before this one */
    float agreement, power;  /* means of w dy and w^2 from turn to turn, each over some 40 turns */
    float strayed, straying; /* of a still reading: what it has corrected since then, place and velocity a tick */
    float balance;           /* unexplained when that began: a finger's steady force */
    float compared_v, unexplained; /* at the last comparison: y, and nu but for a share of it */
    float apart[2], moving[2];     /* at the last two: motion that the model does not explain, and w */
    float place, off;        /* of the last violation: the farther place of rest, and |nu| */
    int32_t violated;        /* a limit is, and nobody has seen to it */
    int32_t last_code;       /* of the last tick */
    uint32_t changed_tick;   /* since when the reading is last_code */
    int32_t lowest, highest; /* of the reading since it is constant */
    tact_section_state weighting[TACT_WEIGHTING_COUNT];
} tact_guard_state;

/* At rest at zero. tick: any count of ticks, here and below the same. */
void tact_guard_reset(tact_guard_state *state, uint32_t tick);

/* A run begins: what moved before says nothing of a constant reading. */
void tact_guard_begin(tact_guard_state *state);

/* 1 << fault for each fault that the last reading shows; when tact_guard_sense() found a limit violated. */
uint32_t tact_guard_name(const tact_safety_channel *safety, const tact_guard_state *state, uint32_t tick);

/* The slow part, every so many ticks: 1 << fault for each fault found. */
uint32_t tact_guard_compare(const tact_safety_channel *safety, tact_guard_state *state, int32_t turns, uint32_t tick);

/* One reading, with the volts that the motor has from now on: gives y; *violated becomes 1 where a limit is
 * passed (NaN passes it). */
static inline float tact_guard_sense(const tact_safety_channel *safety, tact_guard_state *state, int32_t code,
                                     float motor_v, uint32_t tick, int *violated)
{
    const float x = state->x, w = state->w, y = tact_converter_position_v(&safety->converter, code);
    const float nu = y - x, half = 0.5f * nu, off = __builtin_fabsf(nu);
    const float pushed = safety->drive * (motor_v + state->motor_before_v);
    const float next = w + ((pushed - safety->damp * w) - (safety->spring * x - safety->correct_w * nu));
    const float moved = x + (next + safety->correct_x * nu);
    const float place = __builtin_fabsf((moved + safety->stop_lead * next) + half) + 0.5f * off;
    state->motor_before_v = motor_v;
    state->x = moved;
    state->w = next;
    if (code != state->last_code) {
        state->last_code = code;
        state->changed_tick = tick;
    }
    if (!(place <= safety->stop_max_v && off <= safety->disagreement_v)) {
        state->place = place;
        state->off = off;
        state->violated = *violated = 1;
    }
    return y;
}

#endif
