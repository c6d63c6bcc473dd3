#include "host/exciter.h"

static void step(tact_exciter_mode *mode, double command_v, double step_s)
{
    const double x = mode->position;
    const double spring = mode->stiffness * (1.0 + mode->hardening * x * x) * x;
    mode->speed += step_s * (mode->drive * command_v - mode->damping * mode->speed - spring);
    mode->position += step_s * mode->speed;
}

void tact_exciter_run(tact_exciter *exciter, const double *command_v, double *acceleration, double *displacement,
                      size_t count)
{
    tact_exciter_mode *const one = &exciter->mode[0], *const other = &exciter->mode[1];
    const double sample_s = exciter->step_s * (double)exciter->substeps;
    for (size_t k = 0; k < count; k++) {
        const double before = one->speed + other->speed;
        for (int32_t i = 0; i < exciter->substeps; i++) {
            step(one, command_v[k], exciter->step_s);
            step(other, command_v[k], exciter->step_s);
        }
        acceleration[k] = (one->speed + other->speed - before) / sample_s;
        displacement[k] = one->position + other->position;
    }
}
