#include "control/controller_q31.h"

extern inline int32_t tact_q31_of(float value, float scale);
extern inline int32_t tact_controller_q31_limit(const tact_controller_q31 *table, tact_controller_q31_state *state,
                                                int32_t reference, int32_t wanted);
extern inline float tact_controller_q31_step(const tact_controller_q31 *table, tact_controller_q31_state *state,
                                             float reference, float position_v);

void tact_controller_q31_reset(tact_controller_q31_state *state)
{
    for (int i = 0; i < TACT_PREFILTER_MAX; i++)
        state->prefilter[i].s1 = state->prefilter[i].s2 = 0;
    for (int i = 0; i < TACT_FEEDBACK_MAX; i++)
        state->feedback[i].s1 = state->feedback[i].s2 = 0;
    state->clamped = 0;
}

static void add(int64_t *to, int32_t gain, uint8_t shift, int64_t excess)
{
    *to = tact_q31_bounded(*to + ((gain * excess) >> shift));
}

void tact_controller_q31_unwind(const tact_controller_q31 *table, tact_controller_q31_state *state, int32_t reference,
                                int64_t excess)
{
    tact_section_q31_state *last = &state->feedback[table->feedback_count - 1];
    const int64_t size = reference < 0 ? -(int64_t)reference : reference;
    const int64_t most = size > table->reference_max ? size : table->reference_max;
    const int64_t nearer = reference + ((table->unwinding[2] * excess) >> (TACT_Q31_EXTRA + table->unwinding_shift[2]));
    int32_t change = tact_q31_saturated((nearer > most ? most : nearer < -most ? -most : nearer) - reference);
    for (int32_t i = 0; i < table->prefilter_count; i++)
        change = tact_section_q31_shift(&table->prefilter[i], &state->prefilter[i], change);
    for (int32_t i = 0; i < table->feedback_count; i++)
        change = tact_section_q31_shift(&table->feedback[i], &state->feedback[i], change);
    add(&last->s1, table->unwinding[0], table->unwinding_shift[0], excess - change);
    add(&last->s2, table->unwinding[1], table->unwinding_shift[1], excess - change);
}

void tact_controller_q31_run(const tact_controller_q31 *table, tact_controller_q31_state *state,
                             const float *reference, const float *position_v, float *command_v, size_t samples)
{
    for (size_t k = 0; k < samples; k++)
        command_v[k] = tact_controller_q31_step(table, state, reference[k], position_v[k]);
}
