#include "arithmetic/section.h"

static int is_tiny(float value)
{
    return value < TACT_TINY && value > -TACT_TINY;
}

void tact_sections_rest(tact_section_state *state, int32_t count)
{
    for (int32_t i = 0; i < count && is_tiny(state[i].s1) && is_tiny(state[i].s2); i++)
        state[i].s1 = state[i].s2 = 0.0f;
}
