#include "control/controller.h"

void tact_controller_reset(const tact_controller *table, tact_controller_state *state)
{
    for (int i = 0; i < TACT_PREFILTER_MAX; i++)
        state->prefilter[i].s1 = state->prefilter[i].s2 = 0.0f;
    for (int i = 0; i < TACT_FEEDBACK_MAX; i++)
        state->feedback[i].s1 = state->feedback[i].s2 = 0.0f;
    state->clamped = state->broken = 0;
    state->touch.weight[0] = state->touch.weight[1] = 0.0f;
    if (table->touch.delay)
        tact_touch_reset(&table->touch, &state->touch);
}

/* Within +/- most; a NaN stays one. */
static float within(float value, float most)
{
    const float cut = value > most ? most : value;
    return cut < -most ? -most : cut;
}

/* Where the sections' answer to `reference` was cut by `excess` volts (command less answer). */
static void unwind(const tact_controller *table, tact_controller_state *state, float reference, float excess)
{
    tact_section_state *last = &state->feedback[table->feedback_count - 1];
    const float size = reference < 0.0f ? -reference : reference;
    const float most = size > table->reference_max ? size : table->reference_max;
    float change = within(reference + table->conditioning * excess, most) - reference;
    for (int32_t i = 0; i < table->prefilter_count; i++)
        change = tact_section_shift(&table->prefilter[i], &state->prefilter[i], change);
    for (int32_t i = 0; i < table->feedback_count; i++)
        change = tact_section_shift(&table->feedback[i], &state->feedback[i], change);
    const float missing = excess - change;
    last->s1 += table->anti_windup[0] * missing;
    last->s2 += table->anti_windup[1] * missing;
}

float tact_controller_limit(const tact_controller *table, tact_controller_state *state, float reference, float wanted)
{
    const float command = within(wanted, table->command_max_v);
    if (command != wanted && table->feedback_count)
        unwind(table, state, reference, command - wanted);
    state->broken |= !(wanted < TACT_COMMAND_MAX && wanted > -TACT_COMMAND_MAX);
    return state->broken ? 0.0f : command;
}
