#include "arithmetic/converter.h"

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
    converter->rest_code = tact_converter_code(converter, 0.0f);
}
