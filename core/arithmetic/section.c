#include "arithmetic/section.h"

extern inline float tact_section_step(const tact_section *section, tact_section_state *state, float x);
extern inline float tact_section_awake(float b0, float b1, float b2, float a1, float a2, tact_section_state *state,
                                       float x);
extern inline float tact_section_shift(const tact_section *section, tact_section_state *state, float x);
