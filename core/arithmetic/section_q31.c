#include "arithmetic/section_q31.h"

extern inline int64_t tact_q31_bounded(int64_t state);
extern inline int32_t tact_q31_saturated(int64_t value);
extern inline int32_t tact_q31_rounded(int64_t sum);
extern inline int32_t tact_section_q31_step(const tact_section_q31 *section, tact_section_q31_state *state, int32_t x);
extern inline int32_t tact_section_q31_shift(const tact_section_q31 *section, tact_section_q31_state *state,
                                             int32_t x);

void tact_cascade_q31_run(const tact_section_q31 *sections, tact_section_q31_state *states, int count,
                          const int32_t *x, int32_t *y, size_t samples)
{
    for (size_t k = 0; k < samples; k++) {
        int32_t value = x[k];
        for (int i = 0; i < count; i++)
            value = tact_section_q31_step(&sections[i], &states[i], value);
        y[k] = value;
    }
}
