#include "control/controller.h"

extern inline float tact_controller_clamp(float wanted, float lowest, float highest);
extern inline int tact_controller_is_sound(float wanted);
extern inline float tact_controller_change(float conditioning, float reference_max, float reference, float excess);
extern inline float tact_controller_limit(const tact_controller *table, tact_controller_state *state, float reference,
                                          float wanted);
extern inline float tact_controller_sections(const tact_controller *table, tact_controller_state *state, float reference,
                                             float position_v);
extern inline float tact_controller_step(const tact_controller *table, tact_controller_state *state, float reference,
                                         float position_v);

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

void tact_controller_run(const tact_controller *table, tact_controller_state *state, const float *reference,
                         const float *position_v, float *command_v, size_t samples)
{
    for (size_t k = 0; k < samples; k++)
        command_v[k] = tact_controller_step(table, state, reference[k], tact_finite(position_v[k], TACT_POSITION_MAX));
}
