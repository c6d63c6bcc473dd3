#include "arithmetic/converter.h"

extern inline float tact_converter_position_v(const tact_converter *converter, int32_t code);
extern inline int32_t tact_nearest(float x);
extern inline int32_t tact_converter_code(const tact_converter *converter, float command_v);
extern inline double tact_converter_motor_v(const tact_converter *converter, int32_t code);
extern inline int32_t tact_converter_sense(const tact_converter *converter, double position_v);

void tact_converter_make(tact_converter *converter, int bits, double range_v, double polarity, double offset_v)
{
    const int32_t half = (int32_t)1 << (bits - 1);
    converter->step_v = range_v / (double)half;
    converter->steps_per_v = (double)half / range_v;
    converter->motor_step_v = polarity * converter->step_v;
    converter->offset_v = offset_v;
    converter->step_v_single = (float)converter->step_v;
    converter->motor_step_v_single = (float)converter->motor_step_v;
    converter->motor_steps_per_v_single = (float)(polarity * converter->steps_per_v);
    converter->offset_v_single = (float)offset_v;
    converter->code_min = -half;
    converter->code_max = half - 1;
}

void tact_converter_codes(const tact_converter *converter, const float *command_v, int32_t *codes, size_t samples)
{
    for (size_t k = 0; k < samples; k++)
        codes[k] = tact_converter_code(converter, tact_finite(command_v[k], 1e6f));
}

void tact_converter_senses(const tact_converter *converter, const double *position_v, int32_t *codes, size_t samples)
{
    for (size_t k = 0; k < samples; k++)
        codes[k] = tact_converter_sense(converter, tact_finite_double(position_v[k], 1e6));
}
