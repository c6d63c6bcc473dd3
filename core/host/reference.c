/* The bits of a double without its sign, read as an integer, grow with its size; infinity is above every finite number,
 * and what is no number above infinity. One subtraction therefore tells, and four at once make one vector operation. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("O3")
#endif

#include "host/reference.h"

#include <stdint.h>

static int64_t bits_of(double x)
{
    const union {
        double number;
        int64_t bits;
    } same = {x};
    return same.bits;
}

int tact_reference_take(const double *restrict from, double *restrict to, size_t count, double most)
{
    const int64_t top = bits_of(most);
    int64_t beyond = 0; /* negative: one was */
    for (size_t k = 0; k < count; k++) {
        to[k] = from[k];
        beyond |= top - (bits_of(from[k]) & INT64_MAX);
    }
    return beyond >= 0;
}
