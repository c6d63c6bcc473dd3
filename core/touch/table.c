#include "touch/table.h"

static void to_zero(float *values, int count)
{
    for (int i = 0; i < count; i++)
        values[i] = 0.0f;
}

void tact_touch_rest_model(tact_touch_state *state)
{
    for (int i = 0; i < TACT_TOUCH_FEEDBACK_MAX; i++)
        state->feedback[i].s1 = state->feedback[i].s2 = 0.0f;
    state->plant.s1 = state->plant.s2 = 0.0f;
    to_zero(state->model, 3);
    to_zero(state->model_v, TACT_TOUCH_DELAY_MAX);
    state->slow[1] = state->slow[2] = 0.0f;
}

/* What was learnt. */
static void forget(const tact_touch *table, tact_touch_state *state)
{
    state->by_command = state->by_change = state->by_place = 0.0f;
    state->weight[0] = state->weight[1] = state->product[0] = state->product[1] = 0.0f;
    state->power = state->level = state->slow[0] = state->hum_learnt = 0.0f;
    state->square[0] = state->square[2] = table->ridge / table->gate;
    state->square[1] = 0.0f;
    to_zero(state->hum[0], 2 * TACT_TOUCH_HUM_MAX);
    state->left = table->turns - table->turn;
}

void tact_touch_reset(const tact_touch *table, tact_touch_state *state)
{
    tact_touch_rest_model(state);
    to_zero(state->balance, 3);
    to_zero(state->command_v, TACT_TOUCH_DELAY_MAX);
    state->at = 0;
    forget(table, state);
}

int tact_touch_is_valid(const tact_touch *table)
{
    return table->delay >= 1 && table->delay <= TACT_TOUCH_DELAY_MAX && table->turns >= 1 && table->turn >= 0 &&
           table->turn < table->turns && table->hum_count >= 0 && table->hum_count <= TACT_TOUCH_HUM_MAX &&
           table->push_max_v >= 0.0f && table->weight_max >= 0.0f && table->ridge > 0.0f && table->gate > 0.0f &&
           table->forgetting >= 0.0f && (float)TACT_TOUCH_LEVEL_RATE * table->forgetting <= 1.0f;
}
