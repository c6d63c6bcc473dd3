/* Two modes that are driven by one coil, the first with a spring that hardens (exciter.py), stepped by the semi-implicit
 * rule of Euler at `substeps` of a sample. The acceleration is the mean over the sample. */
#include <stddef.h>

typedef struct {
    double drive, damping, stiffness, hardening; /* mm/s^2 for a volt, 1/s, 1/s^2, 1/mm^2 */
    double position, speed;                      /* mm, mm/s */
} mode;

void exciter_run(mode *modes, double step_s, int substeps, const double *command_v, double *acceleration,
                 double *displacement, size_t count);

static void step(mode *m, double command_v, double step_s)
{
    const double spring = m->stiffness * (1.0 + m->hardening * m->position * m->position) * m->position;
    m->speed += step_s * (m->drive * command_v - m->damping * m->speed - spring);
    m->position += step_s * m->speed;
}

void exciter_run(mode *modes, double step_s, int substeps, const double *command_v, double *acceleration,
                 double *displacement, size_t count)
{
    for (size_t k = 0; k < count; k++) {
        const double before = modes[0].speed + modes[1].speed;
        for (int i = 0; i < substeps; i++) {
            step(&modes[0], command_v[k], step_s);
            step(&modes[1], command_v[k], step_s);
        }
        acceleration[k] = (modes[0].speed + modes[1].speed - before) / (step_s * substeps);
        displacement[k] = modes[0].position + modes[1].position;
    }
}
