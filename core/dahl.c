#include "dahl.h"

void tact_dahl_run(size_t count, const double *position, double presliding, double *previous, double *z, double *out)
{
    double last = *previous;
    double state = *z;
    const double scale = 0.5 / presliding;
    for (size_t k = 0; k < count; k++) {
        const double half = (position[k] - last) * scale;
        const double size = half < 0.0 ? -half : half;
        const double target = half < 0.0 ? -1.0 : 1.0;
        const double decay = size < 1.0 ? (1.0 - size) / (1.0 + size) : 0.0;
        state = target + (state - target) * decay;
        last = position[k];
        out[k] = state;
    }
    *previous = last;
    *z = state;
}
