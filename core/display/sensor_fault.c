#include "display/sensor_fault.h"

enum { SPREAD = 2 };

void tact_sensor_fault_set(tact_sensor_fault *fault, int32_t kind, float value, int32_t code)
{
    const int is_code = value > -16777216.0f && value < 16777216.0f;
    fault->kind = kind;
    fault->value = value;
    fault->held = kind == TACT_SENSOR_STUCK && is_code ? (int32_t)value : code;
    fault->state = kind == TACT_SENSOR_LAG ? (double)code : 0.0;
    tact_noise_seed(&fault->noise, 1, (uint32_t)kind);
}

static int32_t within(const tact_converter *converter, double code)
{
    const double low = (double)converter->code_min, high = (double)converter->code_max;
    const double cut = code > low ? code : low; /* NaN fails */
    const double inside = cut < high ? cut : high;
    return (int32_t)(inside + (inside < 0.0 ? -0.5 : 0.5));
}

static int32_t turned_over(const tact_converter *converter, int32_t code, int32_t bit)
{
    const uint32_t width = (uint32_t)converter->code_max * 2u + 1u; /* as many ones as there are bits */
    const uint32_t turned = ((uint32_t)code ^ (1u << (bit & 31))) & width;
    return turned > (uint32_t)converter->code_max ? (int32_t)(turned - width - 1u) : (int32_t)turned;
}

int32_t tact_sensor_fault_apply(tact_sensor_fault *fault, const tact_converter *converter, const int32_t *sound,
                                int32_t channels, int32_t channel)
{
    const int32_t code = sound[channel];
    const double value = (double)fault->value;
    switch (fault->kind) {
    case TACT_SENSOR_OPEN:
        return converter->code_max;
    case TACT_SENSOR_SHORTED:
        return 0;
    case TACT_SENSOR_FROZEN:
        return fault->held;
    case TACT_SENSOR_REVERSED:
        return within(converter, -(double)code);
    case TACT_SENSOR_STUCK:
        return within(converter, (double)(fault->held + (int32_t)((tact_noise_bits(&fault->noise) >> 8) % 5u) - SPREAD));
    case TACT_SENSOR_OFFSET:
        return within(converter, (double)code + value * converter->steps_per_v);
    case TACT_SENSOR_DRIFT:
        fault->state += value * converter->steps_per_v;
        return within(converter, (double)code + fault->state);
    case TACT_SENSOR_GAIN:
        return within(converter, (double)code * value);
    case TACT_SENSOR_LAG:
        fault->state += ((double)code - fault->state) / (1.0 + (value > 0.0 ? value : 0.0));
        return within(converter, fault->state);
    case TACT_SENSOR_SWAPPED:
        return value >= 0.0 && value < (double)channels ? sound[(int32_t)value] : code;
    case TACT_SENSOR_BIT:
        return value >= 0.0 && value < 24.0 ? turned_over(converter, code, (int32_t)value) : code;
    default:
        return code;
    }
}

double tact_sensor_fault_force_v(const tact_sensor_fault *fault, double displacement_mm)
{
    const double stop_mm = (double)fault->value;
    if (fault->kind != TACT_SENSOR_END_STOP)
        return 0.0;
    if (displacement_mm > stop_mm)
        return TACT_END_STOP_V_PER_MM * (stop_mm - displacement_mm);
    return displacement_mm < -stop_mm ? TACT_END_STOP_V_PER_MM * (-stop_mm - displacement_mm) : 0.0;
}
