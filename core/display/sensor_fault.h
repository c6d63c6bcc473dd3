/* Faults of a sensor, for boards whose display is simulated: what the A/D gives once the sensor lies.
 *
 *     sound code --> [ open, shorted, frozen, reversed, stuck, offset, drift, gain, lag, swapped, bit ] --> code
 *
 *     kind       value
 *     STUCK      code about which it gives any of five; NaN: where it is
 *     OFFSET     volts                         GAIN      factor
 *     DRIFT      volts a tick                  LAG       ticks, time constant
 *     SWAPPED    the channel whose reading it is         BIT       number of the bit that is turned over
 *     END_STOP   mm: no fault of the sensor, but the travel ends there, on a stiff spring
 *
 * Example use:
 *   tact_sensor_fault_set(&fault, TACT_SENSOR_OFFSET, 0.1f, code);
 *   code = tact_sensor_fault_apply(&fault, &converter, sound, channels, c);
 */
#ifndef TACT_SENSOR_FAULT_H
#define TACT_SENSOR_FAULT_H

#include <stdint.h>

#include "arithmetic/converter.h"
#include "arithmetic/noise.h"

typedef enum {
    TACT_SENSOR_SOUND = 0,
    TACT_SENSOR_OPEN,
    TACT_SENSOR_SHORTED,
    TACT_SENSOR_FROZEN,
    TACT_SENSOR_REVERSED,
    TACT_SENSOR_STUCK,
    TACT_SENSOR_OFFSET,
    TACT_SENSOR_DRIFT,
    TACT_SENSOR_GAIN,
    TACT_SENSOR_LAG,
    TACT_SENSOR_SWAPPED,
    TACT_SENSOR_BIT,
    TACT_SENSOR_END_STOP,
    TACT_SENSOR_LAST = TACT_SENSOR_END_STOP
} tact_sensor_fault_kind;

#define TACT_END_STOP_V_PER_MM 10.0 /* a force in volts of command */

typedef struct {
    int32_t kind;
    float value;
    int32_t held; /* code at which it is stuck, or frozen */
    double state; /* of drift and lag, codes */
    tact_noise noise;
} tact_sensor_fault;

/* The fault begins; code: the reading before it. */
void tact_sensor_fault_set(tact_sensor_fault *fault, int32_t kind, float value, int32_t code);

/* The reading of `channel`, whose converter this is, where sound ones would be `sound`, one for each of `channels`. */
int32_t tact_sensor_fault_apply(tact_sensor_fault *fault, const tact_converter *converter, const int32_t *sound,
                                int32_t channels, int32_t channel);

/* The force of the end stop, volts of command. */
double tact_sensor_fault_force_v(const tact_sensor_fault *fault, double displacement_mm);

#endif
