/* One channel's controller in Q31: the diagram of controller.h in integers.
 *
 *     reference   full scale 1000 threshold units (60 dB SL)      1 LSB = 4.7e-7
 *     y, v, e, u  full scale 512 V                                1 LSB = 0.24 uV
 *
 * Between sections each image sets its own full scales (powers of two, in the coefficients), so that nothing saturates
 * for a reference up to full scale and a position within the converters' range. Floats appear only at the edges.
 *
 * Example use:
 *   tact_controller_q31_state state;
 *   tact_controller_q31_reset(&state);
 *   float command_v = tact_controller_q31_step(&table, &state, reference, position_v);
 */
#ifndef TACT_CONTROLLER_Q31_H
#define TACT_CONTROLLER_Q31_H

#include "control/controller.h"
#include "arithmetic/section_q31.h"

enum { TACT_Q31_CONDITIONING_SHIFT_MAX = 62 - TACT_Q31_EXTRA };

#define TACT_Q31_PER_VOLT 4194304.0f         /* 2^31 / 512 V: conditioning needs the command before its limits */
#define TACT_Q31_PER_THRESHOLD 2147483.648f  /* 2^31 / 1000 */

typedef struct {
    int32_t prefilter_count;
    int32_t feedback_count; /* 0: no feedback */
    tact_section_q31 prefilter[TACT_PREFILTER_MAX];
    tact_section_q31 feedback[TACT_FEEDBACK_MAX];
    int32_t unwinding[3]; /* anti-windup's two gains, and the conditioning: mantissas over 2^(21 + shift), within 2^30 */
    uint8_t unwinding_shift[3];
    int32_t reference_max; /* Q31 of 1000 threshold units */
    int32_t command_max;   /* Q31 of 512 V */
} tact_controller_q31;

typedef struct {
    tact_section_q31_state prefilter[TACT_PREFILTER_MAX];
    tact_section_q31_state feedback[TACT_FEEDBACK_MAX];
    int32_t clamped;
} tact_controller_q31_state;

void tact_controller_q31_reset(tact_controller_q31_state *state);

/* value (any bits) times scale, towards zero, saturated; NaN gives 0. */
inline int32_t tact_q31_of(float value, float scale)
{
    const float scaled = value * scale, most = 2147483520.0f; /* the last float32 below 2^31 */
    if (__builtin_fabsf(scaled) <= most)
        return (int32_t)scaled;
    return scaled > most ? (int32_t)most : scaled < -most ? INT32_MIN : 0;
}

/* Anti-windup, as tact_controller_unwind(). */
void tact_controller_q31_unwind(const tact_controller_q31 *table, tact_controller_q31_state *state, int32_t reference,
                                int64_t excess);

/* The limits and the anti-windup, as tact_controller_limit(). */
inline int32_t tact_controller_q31_limit(const tact_controller_q31 *table, tact_controller_q31_state *state,
                                         int32_t reference, int32_t wanted)
{
    const int32_t cut = wanted > table->command_max ? table->command_max : wanted;
    const int32_t command = cut < -table->command_max ? -table->command_max : cut;
    if (command != wanted && table->feedback_count)
        tact_controller_q31_unwind(table, state, reference, (int64_t)command - wanted);
    state->clamped = command != wanted;
    return command;
}

/* One sample: reference (threshold units) and position (volts) in, command (volts, within the limits) out. */
inline float tact_controller_q31_step(const tact_controller_q31 *table, tact_controller_q31_state *state,
                                      float reference, float position_v)
{
    const int32_t asked = tact_q31_of(reference, TACT_Q31_PER_THRESHOLD);
    int32_t value = asked;
    for (int32_t i = 0; i < table->prefilter_count; i++)
        value = tact_section_q31_step(&table->prefilter[i], &state->prefilter[i], value);
    if (table->feedback_count != 0) {
        const int32_t position = tact_q31_of(position_v, TACT_Q31_PER_VOLT);
        value = tact_q31_saturated((int64_t)value - position);
        for (int32_t i = 0; i < table->feedback_count; i++)
            value = tact_section_q31_step(&table->feedback[i], &state->feedback[i], value);
    }
    return (float)tact_controller_q31_limit(table, state, asked, value) * (1.0f / TACT_Q31_PER_VOLT);
}

/* samples of one channel, for tests and benchmarks. */
void tact_controller_q31_run(const tact_controller_q31 *table, tact_controller_q31_state *state,
                             const float *reference, const float *position_v, float *command_v, size_t samples);

#endif
