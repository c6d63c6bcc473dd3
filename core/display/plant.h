/* Linear plant, exact under a zero-order hold, double.
 *
 *     x' = A x + B u + L u_before,    y = c x + direct u
 *
 * The states are the plant's own (xi, dxi/dt, ...) of the controller canonical form, scaled: they mean the same with
 * and without a load, so another table of the same order can take over at any sample, and position and velocity go on.
 * L is there for a dead time that ends within a sample: the input of the sample before still acts for a while.
 * Two rows of output: what the sensor measures, in volts, and the displacement of the fingerpad, in mm.
 *
 * Example use:
 *   double position_v = tact_plant_output(plant.order, plant.sensor, x) + plant.sensor_direct * held_v;
 *   tact_plant_step(&plant, x, input_v, before_v, disturbance_v);
 */
#ifndef TACT_PLANT_H
#define TACT_PLANT_H

#include <stddef.h>
#include <stdint.h>

enum { TACT_ORDER_MAX = 8 };

typedef struct {
    int32_t order; /* 1 to TACT_ORDER_MAX */
    double a[TACT_ORDER_MAX][TACT_ORDER_MAX];
    double b[TACT_ORDER_MAX];    /* for the whole sample */
    double late[TACT_ORDER_MAX]; /* the part of b over which the input of the sample before still acts */
    double sensor[TACT_ORDER_MAX], displacement[TACT_ORDER_MAX];
    double sensor_direct, displacement_direct;
} tact_plant;

/* row times x: both outputs are one of these. */
static inline double tact_plant_output(int32_t order, const double *row, const double *x)
{
    double sum = row[0] * x[0];
    for (int32_t i = 1; i < order; i++)
        sum += row[i] * x[i];
    return sum;
}

/* One sample on. input_v acts for this sample but for the part `late`, in which before_v does; disturbance_v acts
 * throughout. */
static inline void tact_plant_step(int32_t order, const tact_plant *plant, double *x, double input_v, double before_v,
                            double disturbance_v)
{
    double next[TACT_ORDER_MAX];
    const double total_v = input_v + disturbance_v, change_v = before_v - input_v;
    for (int32_t i = 0; i < order; i++)
        next[i] = tact_plant_output(order, plant->a[i], x) + (plant->late[i] * change_v + plant->b[i] * total_v);
    for (int32_t i = 0; i < order; i++)
        x[i] = next[i];
}

#endif
