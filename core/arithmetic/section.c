#include "arithmetic/section.h"

extern inline float tact_section_step(const tact_section *section, tact_section_state *state, float x);
extern inline float tact_section_awake(float b0, float b1, float b2, float a1, float a2, tact_section_state *state,
                                       float x);
extern inline float tact_section_shift(const tact_section *section, tact_section_state *state, float x);

void tact_cascade_run(const tact_section *sections, tact_section_state *states, int count, const float *x, float *y,
                      size_t samples)
{
    for (size_t k = 0; k < samples; k++) {
        float value = tact_finite(x[k], 1e30f);
        for (int i = 0; i < count; i++)
            value = tact_section_step(&sections[i], &states[i], value);
        y[k] = value;
    }
}
