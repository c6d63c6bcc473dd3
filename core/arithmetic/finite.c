#include "arithmetic/finite.h"

int tact_finite_is_ieee(void)
{
    volatile float smallest_normal = 1.17549435e-38f;
    volatile float half = smallest_normal * 0.5f; /* volatile: computed here and now, not by the compiler */
    return half > 0.0f && half * 2.0f == smallest_normal;
}
