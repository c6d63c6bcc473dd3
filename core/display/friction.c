#include "display/friction.h"

void tact_friction_run(const tact_friction *friction, tact_friction_state *state, const double *position,
                       double *force_v, size_t samples)
{
    tact_friction_state now = *state; /* a copy that no force can overlap stays in registers */

    for (size_t k = 0; k < samples; k++)
        force_v[k] = tact_friction_step(friction, &now, position[k]);
    *state = now;
}
