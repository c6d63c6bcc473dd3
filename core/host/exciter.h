/* A simulated exciter for a sound card: two modes that are driven by one coil, the first with a spring that hardens.
 *
 *     x1'' + damping1 x1' + stiffness1 (1 + hardening x1^2) x1 = drive1 u        acceleration = x1'' + x2''
 *     x2'' + damping2 x2' + stiffness2                      x2 = drive2 u        displacement = x1 + x2
 *
 * A Duffing oscillator beside a linear one, stepped by the semi-implicit rule of Euler at `substeps` of a sample; the
 * command is held over the sample, and the acceleration is the mean over it. Another arithmetic than the simulated
 * display's, on purpose: it is what an open loop is identified, equalised and verified on.
 *
 * Example use:
 *   tact_exciter exciter = {{{...}, {...}}, 1.0 / (48000 * 4), 4};
 *   tact_exciter_run(&exciter, command_v, acceleration, displacement, 1024);
 */
#ifndef TACT_EXCITER_H
#define TACT_EXCITER_H

#include <stddef.h>
#include <stdint.h>

typedef struct {
    double drive;     /* mm/s^2 for a volt */
    double damping;   /* 1/s */
    double stiffness; /* 1/s^2 */
    double hardening; /* 1/mm^2 */
    double position;  /* mm */
    double speed;     /* mm/s */
} tact_exciter_mode;

typedef struct {
    tact_exciter_mode mode[2];
    double step_s; /* of a substep */
    int32_t substeps;
} tact_exciter;

/* Steps through `count` samples of command (V); acceleration in mm/s^2, displacement in mm. */
void tact_exciter_run(tact_exciter *exciter, const double *command_v, double *acceleration, double *displacement,
                      size_t count);

#endif
