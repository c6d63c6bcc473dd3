/* Dahl friction in volts of command.
 *
 *     dF/dx = sigma (1 - (F/level) sgn dx/dt),   sigma = level / presliding
 *
 *       F |        ______ level           Small motions see a spring of stiffness sigma, large ones a Coulomb level;
 *         |     /                         a reversal builds the force up again over about one presliding distance.
 *     ____|___/____ x
 *         |  presliding                   Backward Euler over one sample: F' = (F + sigma dx)/(1 + sigma |dx|/level),
 *                                         which never leaves +/- level, whatever dx, and needs no exp.
 * (Dahl 1968; Astrom & Canudas de Wit 2008.)
 *
 * Example use:
 *   double force_v = tact_friction_step(&friction, &state, position);
 */
#ifndef TACT_FRICTION_H
#define TACT_FRICTION_H

#include <stddef.h>

typedef struct {
    double stiffness;     /* sigma: volts of command per unit of position */
    double per_presliding; /* sigma / level: 1 per unit of position */
} tact_friction;

typedef struct {
    double force_v;
    double position;
} tact_friction_state;

/* Force against the motion, after a sample in which the position came to be `position`. */
static inline double tact_friction_step(const tact_friction *friction, tact_friction_state *state, double position)
{
    const double moved = position - state->position;
    const double distance = moved < 0.0 ? -moved : moved;
    state->position = position;
    state->force_v = (state->force_v + friction->stiffness * moved) / (1.0 + friction->per_presliding * distance);
    return state->force_v;
}

/* samples of position into forces. */
void tact_friction_run(const tact_friction *friction, tact_friction_state *state, const double *position,
                       double *force_v, size_t samples);

#endif
