#include "host/states.h"

/* States below this are set to rest: subnormal numbers are a hundred times slower. */
#define TINY 1e-200

/* Small sizes with the size known to the compiler are several times faster. */
#define RUN(n)                                                                                                         \
    for (size_t k = 0; k < count; k++) {                                                                               \
        const double now = u[k];                                                                                       \
        const double next = k + 1 < count ? u[k + 1] : now;                                                            \
        double change[TACT_STATES_MAX];                                                                                \
        for (size_t i = 0; i < (n); i++) {                                                                             \
            double sum = b0[i] * now + b1[i] * next;                                                                   \
            for (size_t j = 0; j < (n); j++)                                                                           \
                sum += d[i * (n) + j] * x[j];                                                                          \
            change[i] = sum;                                                                                           \
        }                                                                                                              \
        for (size_t i = 0; i < (n); i++) {                                                                             \
            out[k * (n) + i] = x[i];                                                                                   \
            x[i] += change[i];                                                                                         \
            if (x[i] < TINY && x[i] > -TINY)                                                                           \
                x[i] = 0.0;                                                                                            \
        }                                                                                                              \
    }

int tact_states_run(size_t n, const double *d, const double *b0, const double *b1, size_t count, const double *u,
                    double *x, double *out)
{
    if (n == 0 || n > TACT_STATES_MAX)
        return -1;
    switch (n) {
    case 1:
        RUN((size_t)1)
        break;
    case 2:
        RUN((size_t)2)
        break;
    case 4:
        RUN((size_t)4)
        break;
    case 6:
        RUN((size_t)6)
        break;
    default:
        RUN(n)
    }
    return 0;
}

void tact_low_passes_run(size_t decays, const double *decay, size_t count, const double *u, double *out)
{
    for (size_t i = 0; i < decays; i++) {
        double y = 0.0;
        for (size_t k = 0; k < count; k++)
            out[i * count + k] = y = decay[i] * y + (1.0 - decay[i]) * u[k];
    }
}
