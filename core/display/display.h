/* The simulated display, one channel: the device behind a processor's converters. Double.
 *
 *             force_v ---------+            friction F <--- dx
 *                              v            |
 *   code --> D/A --> delay -->(+)--------->(+-)--> plant --+--> sensor --(+)--> A/D --> code
 *            polarity  dead                                |              ^
 *            offset    time                                +--> mm        noise, hum
 *
 * One period in three calls, at the instant k of an interrupt: latch (the D/A puts a code out), read (the A/D's code),
 * advance (to the instant k + 1). With a code that is computed from this instant's reading, read comes before latch;
 * the plant must then have no direct part.
 *
 * Example use:
 *   tact_display_latch(&table, &state, code, 0.0);
 *   int32_t reading = tact_display_read(&table, &state);
 *   tact_display_advance(&table, &state);
 */
#ifndef TACT_DISPLAY_H
#define TACT_DISPLAY_H

#include <stdint.h>

#include "arithmetic/converter.h"
#include "display/friction.h"
#include "display/hum.h"
#include "arithmetic/noise.h"
#include "display/plant.h"

enum { TACT_DEAD_TIME_MAX = 256 };

#define TACT_FORCE_MAX 1e3 /* volts of command */

typedef struct {
    const tact_plant *plants; /* one per load, all of the same order; [0]: nothing touches */
    int32_t plant_count;
    int32_t dead_time; /* whole samples, below TACT_DEAD_TIME_MAX */
    int32_t has_late;  /* the dead time's rest is in the plants' `late` */
    tact_converter converter;
    tact_friction friction;
    double sensor_v_per_mm; /* friction's position is this times the displacement */
    double noise_v;         /* volts per unit of tact_noise_next() */
    tact_hum hum;
} tact_display;

typedef struct {
    int32_t touched; /* which of the plants */
    int32_t dead_at;
    double dead_time_v[TACT_DEAD_TIME_MAX];
    double x[TACT_ORDER_MAX];
    double motor_v, before_v; /* after the dead time: in this period, and in the one before */
    double force_v;
    double displacement_mm;
    tact_friction_state friction;
    tact_hum_state hum;
    tact_noise noise;
} tact_display_state;

/* At rest, untouched, with its own noise. The hum's phases start at zero. */
void tact_display_reset(const tact_display *table, tact_display_state *state, uint32_t seed, uint32_t channel);

/* The plant that the load in force selects. */
static inline const tact_plant *tact_display_plant(const tact_display *table, const tact_display_state *state)
{
    return &table->plants[state->touched];
}

/* The D/A puts `code` out; force_v (volts of command) acts from outside until the next call. Gives the motor's volts. */
static inline double tact_display_latch(const tact_display *table, tact_display_state *state, int32_t code, double force_v)
{
    const double put_out_v = tact_converter_motor_v(&table->converter, code);
    state->force_v = tact_finite_double(force_v, TACT_FORCE_MAX);
    state->before_v = state->motor_v;
    if (table->dead_time == 0) {
        state->motor_v = put_out_v;
    } else {
        state->motor_v = state->dead_time_v[state->dead_at];
        state->dead_time_v[state->dead_at] = put_out_v;
        state->dead_at = state->dead_at + 1 < table->dead_time ? state->dead_at + 1 : 0;
    }
    return put_out_v;
}

/* The sensor at this instant, before noise and hum, in volts; sets the displacement and the friction. */
static inline double tact_display_sense(int32_t order, const tact_display *table, tact_display_state *state)
{
    const tact_plant *plant = tact_display_plant(table, state);
    const double held_v = (table->has_late ? state->before_v : state->motor_v) + state->force_v;
    state->displacement_mm =
        tact_plant_output(order, plant->displacement, state->x) + plant->displacement_direct * held_v;
    (void)tact_friction_step(&table->friction, &state->friction, table->sensor_v_per_mm * state->displacement_mm);
    return tact_plant_output(order, plant->sensor, state->x) + plant->sensor_direct * held_v;
}

/* The A/D's code at this instant. */
static inline int32_t tact_display_read_order(int32_t order, const tact_display *table, tact_display_state *state)
{
    const double clean_v = tact_display_sense(order, table, state);
    const double sensed_v =
        clean_v + (tact_hum_next(&table->hum, &state->hum) + table->noise_v * tact_noise_next(&state->noise));
    return tact_converter_sense(&table->converter, sensed_v);
}

/* To the next instant. */
static inline void tact_display_advance_order(int32_t order, const tact_display *table, tact_display_state *state)
{
    tact_plant_step(order, tact_display_plant(table, state), state->x, state->motor_v, state->before_v,
                    state->force_v - state->friction.force_v);
}

/* The two above for whatever order the plant has. */
int32_t tact_display_read(const tact_display *table, tact_display_state *state);
void tact_display_advance(const tact_display *table, tact_display_state *state);

#endif
