#include "display/friction.h"

extern inline double tact_friction_step(const tact_friction *friction, tact_friction_state *state, double position);

void tact_friction_run(const tact_friction *friction, tact_friction_state *state, const double *position,
                       double *force_v, size_t samples)
{
    for (size_t k = 0; k < samples; k++)
        force_v[k] = tact_friction_step(friction, state, position[k]);
}
