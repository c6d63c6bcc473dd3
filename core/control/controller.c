#include "control/controller.h"

void tact_controller_reset(tact_controller_state *state)
{
    for (int i = 0; i < TACT_PREFILTER_MAX; i++)
        state->prefilter[i].s1 = state->prefilter[i].s2 = 0.0f;
    for (int i = 0; i < TACT_FEEDBACK_MAX; i++)
        state->feedback[i].s1 = state->feedback[i].s2 = 0.0f;
    state->clamped = 0;
    state->broken = 0;
}

int tact_controller_is_valid(const tact_controller *table)
{
    return table->prefilter_count >= 0 && table->prefilter_count <= TACT_PREFILTER_MAX && table->feedback_count >= 0 &&
           table->feedback_count <= TACT_FEEDBACK_MAX && table->command_min_v < table->command_max_v;
}

void tact_controller_unwind(const tact_controller *table, tact_controller_state *state, float reference, float excess)
{
    tact_section_state *last = &state->feedback[table->feedback_count - 1];
    float change = tact_controller_change(table->conditioning, table->reference_max, reference, excess);
    for (int32_t i = 0; i < table->prefilter_count; i++)
        change = tact_section_shift(&table->prefilter[i], &state->prefilter[i], change);
    for (int32_t i = 0; i < table->feedback_count; i++)
        change = tact_section_shift(&table->feedback[i], &state->feedback[i], change);
    const float missing = excess - change;
    last->s1 += table->anti_windup[0] * missing;
    last->s2 += table->anti_windup[1] * missing;
}
