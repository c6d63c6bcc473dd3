/* A/D and D/A: codes and volts.
 *
 *   code |            ____ code_max       The processor's side (float32) turns codes into volts and back; the device's
 *        |        __/                     side (double) is what the hardware does. The command passes through
 *        |      _|                        `polarity` and `offset_v` on its way to the motor, and the processor's side
 *   _____|____|_______________ volts      undoes them beforehand:
 *        |  _|
 *     __/                                      motor volts = polarity * step_v * code + offset_v
 *    code_min |
 *
 * Mid-tread; both ends saturate. Halves: the device rounds them away from zero, the processor to the even code, which is
 * one instruction on a Cortex-M.
 *
 * Example use:
 *   int32_t code = tact_converter_code(&converter, command_v);    (processor)
 *   double at_the_motor_v = tact_converter_motor_v(&converter, code);   (device)
 */
#ifndef TACT_CONVERTER_H
#define TACT_CONVERTER_H

#include <stddef.h>
#include <stdint.h>

#include "arithmetic/finite.h"

typedef struct {
    double step_v, steps_per_v; /* A/D: volts per code */
    double motor_step_v;        /* D/A: volts per code at the motor, the sign is the polarity */
    double offset_v;
    float step_v_single, motor_step_v_single, motor_steps_per_v_single, offset_v_single;
    int32_t code_min, code_max;
    int32_t rest_code; /* D/A: the motor has nothing */
} tact_converter;

/* Processor: volts of an A/D code. */
static inline float tact_converter_position_v(const tact_converter *converter, int32_t code)
{
    return (float)code * converter->step_v_single;
}

/* The whole number nearest to x, of two the even one. |x| is at most 2^23. */
static inline int32_t tact_nearest(float x)
{
#if defined(__arm__) && defined(__ARM_FP)
    int32_t whole;
    __asm("vcvtr.s32.f32 %0, %1" : "=t"(whole) : "t"(x));
    return whole;
#else
    const float whole = (__builtin_fabsf(x) + 8388608.0f) - 8388608.0f;
    return (int32_t)__builtin_copysignf(whole, x);
#endif
}

/* Processor: the D/A code that brings command_v (finite) to the motor; saturates. */
static inline int32_t tact_converter_code(const tact_converter *converter, float command_v)
{
    const float steps = (command_v - converter->offset_v_single) * converter->motor_steps_per_v_single;
    const float low = (float)converter->code_min, high = (float)converter->code_max;
    const float cut = steps > high ? high : steps;
    return tact_nearest(cut < low ? low : cut);
}

/* Device: what the motor sees of a D/A code, volts. */
static inline double tact_converter_motor_v(const tact_converter *converter, int32_t code)
{
    return (double)code * converter->motor_step_v + converter->offset_v;
}

/* Device: the A/D's code for position_v; a NaN gives code_min. */
static inline int32_t tact_converter_sense(const tact_converter *converter, double position_v)
{
    const double steps = position_v * converter->steps_per_v;
    const double low = (double)converter->code_min, high = (double)converter->code_max;
    const double cut = steps > low ? steps : low; /* NaN fails */
    const double inside = cut < high ? cut : high;
    return (int32_t)(inside + (inside < 0.0 ? -0.5 : 0.5));
}

/* bits (8 to 24) over +/- range_v; polarity +1 or -1. */
void tact_converter_make(tact_converter *converter, int bits, double range_v, double polarity, double offset_v);

#endif
