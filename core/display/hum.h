/* Mains hum at the sensor: sinusoids by rotation, no libm.
 *
 *     (c, s) <- (c cos w - s sin w, s cos w + c sin w),   hum = sum of amplitude_v * s
 *
 * cos w and sin w of each line come with the table. Rounding lets a rotation's length creep by about 1e-16 a step;
 * every TACT_HUM_SETTLE steps one Newton step for 1/sqrt brings it back to 1.
 *
 * Example use:
 *   double hum_v = tact_hum_next(&hum, &state);
 */
#ifndef TACT_HUM_H
#define TACT_HUM_H

#include <stdint.h>

enum { TACT_HUM_MAX = 8, TACT_HUM_SETTLE = 1024 };

typedef struct {
    int32_t count;
    double cosine[TACT_HUM_MAX], sine[TACT_HUM_MAX]; /* of the angle per sample */
    double amplitude_v[TACT_HUM_MAX];                /* peak */
} tact_hum;

typedef struct {
    double cosine[TACT_HUM_MAX], sine[TACT_HUM_MAX]; /* of the phase */
    int32_t age;                                     /* steps since the lengths were brought back to 1 */
} tact_hum_state;

/* Lengths back to 1. */
void tact_hum_settle(const tact_hum *hum, tact_hum_state *state);

/* Volts at this instant; then one sample on. */
static inline double tact_hum_next(const tact_hum *hum, tact_hum_state *state)
{
    double volts = 0.0;
    for (int32_t i = 0; i < hum->count; i++) {
        const double c = state->cosine[i], s = state->sine[i];
        volts += hum->amplitude_v[i] * s;
        state->cosine[i] = c * hum->cosine[i] - s * hum->sine[i];
        state->sine[i] = s * hum->cosine[i] + c * hum->sine[i];
    }
    if (++state->age >= TACT_HUM_SETTLE)
        tact_hum_settle(hum, state);
    return volts;
}

#endif
