/* Numbers made safe before arithmetic.
 *
 * A NaN's bits, an overflow to infinity and a subnormal's cost differ between processors. What enters the core
 * therefore passes through tact_finite() once:
 *
 *          limit  ________
 *                /             |x| < TACT_TINY  ->  0
 *       ________/              NaN              ->  0
 *         -limit               +/-inf           ->  +/-limit
 *
 * Example use:
 *   float reference = tact_finite(untrusted, TACT_REFERENCE_MAX);
 */
#ifndef TACT_FINITE_H
#define TACT_FINITE_H

#define TACT_TINY 1e-30f

/* Returns 1 if this thread's arithmetic keeps subnormal numbers. A foreign library may have switched them off; the bits
 * then differ from other processors'. */
int tact_finite_is_ieee(void);

/* x within +/- limit; NaN and anything closer to zero than TACT_TINY become +0. */
static inline float tact_finite(float x, float limit)
{
    const float whole = ((x >= TACT_TINY) | (x <= -TACT_TINY)) ? x : 0.0f; /* NaN fails both */
    const float below = whole > limit ? limit : whole;
    return below < -limit ? -limit : below;
}

/* The same for the double arithmetic of the device model. */
static inline double tact_finite_double(double x, double limit)
{
    const double whole = x == x ? x : 0.0;
    const double below = whole > limit ? limit : whole;
    return below < -limit ? -limit : below;
}

#endif
