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
 * than any force makes it; and one that stands still, but for noise, while the command asks for motion (stuck). Under a
 * steady finger a reading stands still as well, and the loop's integrator holds the finger's force: so it is motion by
 * the command's change since then that counts.
 *
 * The compiler's own __builtin_fabsf is one instruction, and no call.
 *
 * Example use:
 *   int violated = 0;
 *   float position_v = tact_guard_sense(&table, &state, code, motor_v, tick, &violated);
 *   if (violated) faults = tact_guard_name(&safety->channel[c], &state, tick);
 */
#ifndef TACT_GUARD_H
#define TACT_GUARD_H

#include <stdint.h>

#include "arithmetic/float_pair.h"
#include "arithmetic/section.h"
#include "board/safety.h"

#define TACT_GUARD_KEPT 0.975f /* of a mean from one turn to the next: some 40 turns */

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

/* What a tick needs of a safety table, two numbers to a load. */
typedef struct {
    tact_float_pair reading;    /* volts of y per code | drive */
    tact_float_pair returning;  /* 1 - damp | spring */
    tact_float_pair correcting; /* w | x, per volt of nu */
    tact_float_pair resting;    /* stop_lead | stop_max_v */
    tact_float_pair differing;  /* half of disagreement_v | least power of a reversal */
    tact_float_pair comparing;  /* comfort_max | agreement below which the power is looked at */
    tact_section weighting[TACT_WEIGHTING_COUNT];
    tact_float_pair jumping; /* share of the model's own change of motion, per its w | most that remains, volts of y */
    tact_float_pair staying;      /* of the motion that a still reading hides, in a turn: what stays | per its place */
    tact_float_pair uncorrecting; /* per volt of nu since then: taken from its velocity | and from its place */
    float reversed_share;     /* agreement in the power of a reversed sensor */
    uint32_t frozen_ticks;
    int32_t still_codes;      /* a reading within so many codes stands still */
    float stray_max_v;        /* most that it may come to, volts of y */
} tact_guard_table;

typedef struct {
    tact_float_pair model; /* x | w: position and velocity */
    tact_float_pair means; /* agreement | power: w dy in volts and codes, w^2; sums, each term fading over some 40 turns */
    tact_float_pair strayed; /* of a still reading: what it has corrected since then, place | velocity a turn */
    tact_float_pair compared;  /* at the last comparison: y | nu, but for a share of it */
    tact_float_pair before[2]; /* at the last two: motion that the model does not explain | w */
    tact_section_state weighting[TACT_WEIGHTING_COUNT];
    float motor_before_v;             /* in the period before this one */
    float place, apart;               /* of the last violation: the farther place of rest, and |nu|, by size */
    int32_t violated;                 /* a limit is, and nobody has seen to it */
    int32_t last_code;                /* of the last tick */
    uint32_t changed_tick;            /* since when the reading is last_code */
    int32_t lowest, highest;          /* of the reading since it stands still */
    float balance;                    /* unexplained when that began: a finger's steady force */
    float jump;                       /* change of the unexplained motion from two turns ago, less the share allowed */
    float felt;                       /* at the last comparison: threshold units */
} tact_guard_state;

/* The table of a channel that is compared every `turns` ticks. */
void tact_guard_make(tact_guard_table *table, const tact_safety_channel *safety, int32_t turns);

/* At rest at zero. tick: any count of ticks, here and below the same. */
void tact_guard_reset(tact_guard_state *state, uint32_t tick);

/* A run begins: what moved before says nothing of a sensor that stands still. */
void tact_guard_begin(tact_guard_state *state);

/* 1 << fault for each fault that the last reading shows; when tact_guard_sense() found a limit violated. */
uint32_t tact_guard_name(const tact_safety_channel *safety, const tact_guard_state *state, uint32_t tick);

/* What tact_guard_look() tells: 0, or that there is something to name or to bring to rest. */
enum { TACT_SUSPECT = 1, TACT_STRAYS = 2 };

/* A suspicion of this tick, named: 1 << fault for each fault found. Weighting at rest where all is quiet. */
uint32_t tact_guard_confirm(const tact_guard_table *table, tact_guard_state *state, int suspicion, uint32_t tick);

/* tact_guard_look(), and what it suspects named. */
uint32_t tact_guard_compare(const tact_guard_table *table, tact_guard_state *state, uint32_t tick);

/* One reading, with the volts that the motor has from now on: gives y; *violated becomes 1 where a limit is
 * passed (NaN passes it). */
static inline float tact_guard_sense(const tact_guard_table *table, tact_guard_state *state, int32_t code, float motor_v,
                              uint32_t tick, int *violated)
{
    const tact_float_pair reading = tact_float_pair_get(&table->reading), model = tact_float_pair_get(&state->model);
    const tact_float_pair returning = tact_float_pair_get(&table->returning), correcting = tact_float_pair_get(&table->correcting);
    const tact_float_pair resting = tact_float_pair_get(&table->resting);
    const float x = model.first, w = model.second;
    const float y = (float)code * reading.first;
    const float nu = y - x, half = 0.5f * nu, half_apart = __builtin_fabsf(half);
    const float next = returning.first * w + (reading.second * (motor_v + state->motor_before_v) -
                                              (returning.second * x - correcting.first * nu));
    const float moved = x + (next + correcting.second * nu);
    const float place = __builtin_fabsf((moved + resting.first * next) + half) + half_apart;
    state->motor_before_v = motor_v;
    state->model.first = moved;
    state->model.second = next;
    if (code != state->last_code) {
        state->last_code = code;
        state->changed_tick = tick;
    }
    if (!(place <= resting.second && half_apart <= table->differing.first)) {
        state->place = place;
        state->apart = half_apart + half_apart;
        state->violated = *violated = 1;
    }
    return y;
}

/* y to felt reference. */
static inline float tact_guard_weigh(const tact_guard_table *table, tact_section_state *state, float y)
{
    return tact_sections_step(table->weighting, state, TACT_WEIGHTING_COUNT, y);
}

/* How far the motor would have come if the reading, which stands still, were a lie: the observer's place, less all that
 * the reading has corrected it by since then, but for what it was corrected by when that began. Gives 1 where that is
 * too far. */
static inline int tact_guard_stray(const tact_guard_table *table, tact_guard_state *state, int32_t code, float unexplained)
{
    const int32_t lowest = code < state->lowest ? code : state->lowest;
    const int32_t highest = code > state->highest ? code : state->highest;
    if (highest - lowest > table->still_codes) {
        state->lowest = state->highest = code;
        state->balance = unexplained;
        state->strayed.first = state->strayed.second = 0.0f;
        return 0;
    }
    const tact_float_pair staying = tact_float_pair_get(&table->staying), strayed = tact_float_pair_get(&state->strayed);
    const tact_float_pair uncorrecting = tact_float_pair_get(&table->uncorrecting);
    const float change = unexplained - state->balance;
    const float velocity = staying.first * strayed.second - (staying.second * strayed.first + uncorrecting.first * change);
    const float place = strayed.first + velocity;
    state->lowest = lowest;
    state->highest = highest;
    state->strayed.first = place;
    state->strayed.second = velocity;
    return !(__builtin_fabsf(place - uncorrecting.second * change) <= table->stray_max_v);
}

/* The slow part, for a channel whose turn it is, every so many ticks. */
static inline int tact_guard_look(const tact_guard_table *table, tact_guard_state *state, uint32_t tick)
{
    const int32_t code = state->last_code;
    const uint32_t same_ticks = tick - state->changed_tick;
    const float y = (float)code * table->reading.first, w = state->model.second;
    const tact_float_pair means = tact_float_pair_get(&state->means);
    const tact_float_pair compared = tact_float_pair_get(&state->compared), jumping = tact_float_pair_get(&table->jumping);
    const tact_float_pair before = tact_float_pair_get(&state->before[1]), comparing = tact_float_pair_get(&table->comparing);
    const float agreement = TACT_GUARD_KEPT * means.first + w * (y - compared.first);
    const float felt = tact_guard_weigh(table, state->weighting, y);
    const float unexplained = (y + w) - state->model.first, apart = unexplained - compared.second;
    const float jump = __builtin_fabsf(apart - before.first) - jumping.first * __builtin_fabsf(w - before.second);
    state->means.first = agreement;
    state->means.second = TACT_GUARD_KEPT * means.second + w * w;
    state->compared.first = y;
    state->compared.second = unexplained;
    tact_float_pair_copy(&state->before[1], &state->before[0]);
    state->before[0].first = apart;
    state->before[0].second = w;
    state->jump = jump;
    state->felt = felt;
    if (tact_guard_stray(table, state, code, unexplained))
        return TACT_STRAYS;
    const int is_quiet = code == 0 && __builtin_fabsf(state->weighting[0].s1) < TACT_TINY;
    /* A reversed sensor agrees less than the least power would ask for, and more power asks for less still. */
    if (!is_quiet && jump <= jumping.second && __builtin_fabsf(felt) <= comparing.first &&
        !(agreement < comparing.second) && same_ticks < table->frozen_ticks)
        return 0;
    return TACT_SUSPECT;
}

#endif
