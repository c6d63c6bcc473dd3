/* A display's device of one channel, for witnesses: motor, finger, friction, hum, noise, converters. Double.
 *
 *   (1 + m) y'' + a1 y' + a0 y = B (u + f - F) - finger       y: sensor volts; u, f, F: volts of command
 *   F' = (level y' - F |y'|) / presliding                     Dahl's friction (1968)
 *   finger = b y' + k y                                       one mass, damper and spring, or
 *          = b (y' - z') + k (y - z), m2 z'' = finger - b2 z' - k2 z        a Kelvin-Voigt chain of two masses
 *
 * All of it is one set of equations, integrated by Runge and Kutta's fourth order in SUBSTEPS steps a sample with the
 * command held. It includes nothing of core/. The controller is a function that the caller gives: product.c has the one
 * under test.
 *
 * At the instant k of a sample: the D/A puts out the command of `delay` samples before, the A/D reads, the controller
 * answers, and time goes on to k + 1. A dead time of `dead_substeps` lies between D/A and motor.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>

enum { SUBSTEPS = 4, STATES = 5, LINES_MAX = 4, DELAY_MAX = 16, DEAD_MAX = 256 };

typedef struct {
    double mass, damping, stiffness;
    double second_mass, second_damping, second_stiffness; /* second_mass 0: one mass only */
} finger;

typedef struct {
    double rate_hz, gain, damping, stiffness, friction_v, presliding_v, noise_v, step_v;
    double hum_hz[LINES_MAX], hum_v[LINES_MAX], hum_phase[LINES_MAX];
    int32_t code_max, delay, dead_substeps, touching; /* touching: place in `fingers`, 0: nothing touches */
    uint64_t noise, tick, substep;
    double x[STATES]; /* y, y', z, z', F */
    double delayed_v[DELAY_MAX], dead_v[DEAD_MAX];
} device;

typedef float (*controller_step)(void *controller, float reference, float position_v);

/* Uniform in (0, 1): xorshift64* (Vigna 2016). */
static double uniform(device *d)
{
    d->noise ^= d->noise >> 12;
    d->noise ^= d->noise << 25;
    d->noise ^= d->noise >> 27;
    return ((double)((d->noise * 2685821657736338717ull) >> 11) + 0.5) / 9007199254740992.0;
}

/* Normal, by Box and Muller. */
static double normal(device *d)
{
    const double radius = sqrt(-2.0 * log(uniform(d)));
    return radius * cos(2.0 * M_PI * uniform(d));
}

static void slopes(const device *d, const finger *f, const double *x, double drive_v, double *slope)
{
    const int chain = f->second_mass > 0.0;
    const double force = f->damping * (x[1] - (chain ? x[3] : 0.0)) + f->stiffness * (x[0] - (chain ? x[2] : 0.0));
    const double motor = d->gain * (drive_v - x[4]) - d->damping * x[1] - d->stiffness * x[0];
    slope[0] = x[1];
    slope[1] = (motor - force) / (1.0 + f->mass);
    slope[2] = chain ? x[3] : 0.0;
    slope[3] = chain ? (force - f->second_damping * x[3] - f->second_stiffness * x[2]) / f->second_mass : 0.0;
    slope[4] = (d->friction_v * x[1] - x[4] * fabs(x[1])) / d->presliding_v;
}

static void runge_kutta(device *d, const finger *f, double drive_v, double h)
{
    double k[4][STATES], at[STATES];
    const double share[4] = {0.0, 0.5, 0.5, 1.0};
    for (int stage = 0; stage < 4; stage++) {
        for (int i = 0; i < STATES; i++)
            at[i] = d->x[i] + (stage ? share[stage] * h * k[stage - 1][i] : 0.0);
        slopes(d, f, at, drive_v, k[stage]);
    }
    for (int i = 0; i < STATES; i++)
        d->x[i] += h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
}

/* A finger that comes finds its second mass where the display is, and as fast. */
static void touch(device *d, int32_t place)
{
    if (place == d->touching)
        return;
    d->touching = place;
    d->x[2] = place ? d->x[0] : 0.0;
    d->x[3] = place ? d->x[1] : 0.0;
}

static int32_t code_of(const device *d, double volts)
{
    const double code = nearbyint(volts / d->step_v);
    return (int32_t)fmax(-(double)d->code_max - 1.0, fmin((double)d->code_max, code));
}

static double hum(const device *d)
{
    const double time_s = (double)d->tick / d->rate_hz;
    double sum = 0.0;
    for (int i = 0; i < LINES_MAX; i++)
        sum += d->hum_v[i] * sin(2.0 * M_PI * d->hum_hz[i] * time_s + d->hum_phase[i]);
    return sum;
}

static void advance(device *d, const finger *f, double command_v, double force_v)
{
    for (int i = 0; i < SUBSTEPS; i++) {
        const size_t now = d->substep++ % DEAD_MAX, before = (now + DEAD_MAX - (size_t)d->dead_substeps) % DEAD_MAX;
        d->dead_v[now] = command_v;
        runge_kutta(d, f, d->dead_v[before] + force_v, 1.0 / (SUBSTEPS * d->rate_hz));
    }
    d->tick++;
}

/* What the A/D reads now, its code. */
int32_t device_read(device *d)
{
    return code_of(d, d->x[0] + hum(d) + d->noise_v * normal(d));
}

/* On to the next instant, with a code at the D/A and one of the fingers. For who has a delay of his own. */
void device_advance(device *d, int32_t code, const finger *fingers, int32_t place)
{
    touch(d, place);
    advance(d, &fingers[place], d->step_v * code, 0.0);
}

/* n samples: reference (threshold units), touching and force_v in; y (sensor volts, the truth), what the D/A
 * put out in this sample and what the A/D read (volts) out. fingers[0] is none. */
void device_play(device *d, controller_step step, void *controller, size_t n, const double *reference,
                 const finger *fingers, const int32_t *touching, const double *force_v, double *y_v, double *command_v,
                 double *read_v)
{
    for (size_t k = 0; k < n; k++) {
        double *slot = &d->delayed_v[d->tick % (uint64_t)d->delay];
        const double put_out_v = *slot;
        touch(d, touching[k]);
        y_v[k] = d->x[0];
        command_v[k] = put_out_v;
        read_v[k] = d->step_v * device_read(d);
        *slot = d->step_v * code_of(d, step(controller, (float)reference[k], (float)read_v[k]));
        advance(d, &fingers[touching[k]], put_out_v, force_v[k]);
    }
}
