#include "touch/feed_forward.h"

#include "arithmetic/finite.h"

float tact_touch_step(const tact_touch *table, tact_touch_state *state, float wanted_v, float position_v)
{
    if (--state->left <= 0)
        tact_touch_learn(table, state);
    const int32_t at = state->at;
    const float model_v = state->model_v[at];
    tact_touch_pass(table, state, state->command_v[at], model_v, position_v);
    state->model_v[at] = state->plant.s1;
    const float command_v = tact_sections_step(table->feedback, state->feedback, table->feedback_count, wanted_v - model_v);
    return tact_touch_bounded(table, state, tact_touch_move(table, state, command_v));
}
