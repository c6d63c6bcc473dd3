#include "arithmetic/section.h"

extern inline float tact_section_step(const tact_section *section, tact_section_state *state, float x);
extern inline float tact_sections_step(const tact_section *section, tact_section_state *state, int32_t count, float x);
extern inline float tact_section_shift(const tact_section *section, tact_section_state *state, float x);
