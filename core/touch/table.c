#include "touch/table.h"

static void rest_poles(float *poles)
{
    for (int i = 0; i < 3; i++)
        poles[i] = 0.0f;
}

void tact_touch_rest_model(tact_touch_state *state)
{
    for (int i = 0; i < TACT_TOUCH_FEEDBACK_MAX; i++)
        state->feedback[i].s1 = state->feedback[i].s2 = 0.0f;
    state->plant.s1 = state->plant.s2 = 0.0f;
    rest_poles(state->model);
    for (int i = 0; i < TACT_TOUCH_DELAY_MAX; i++)
        state->model_v[i] = 0.0f;
    state->slow[1] = state->slow[2] = 0.0f;
}

/* What was learnt. */
static void forget(const tact_touch *table, tact_touch_state *state)
{
    state->power = state->level = 0.0f;
    state->weight[0] = state->weight[1] = state->product[0] = state->product[1] = 0.0f;
    state->by_command = state->by_change = state->by_place = 0.0f;
    state->square[0] = state->square[2] = table->ridge / table->gate;
    state->square[1] = 0.0f;
    for (int i = 0; i < 3; i++)
        state->slow[i] = 0.0f;
    state->hummed = state->hum_learnt = 0.0f;
    for (int i = 0; i < TACT_TOUCH_HUM_MAX; i++)
        state->hum[i][0] = state->hum[i][1] = state->turned[i][0] = state->turned[i][1] = 0.0f;
    state->is_due = 0;
    state->left = table->turns - table->turn;
}

void tact_touch_reset(const tact_touch *table, tact_touch_state *state)
{
    tact_touch_rest_model(state);
    rest_poles(state->balance);
    for (int i = 0; i < TACT_TOUCH_DELAY_MAX; i++)
        state->command_v[i] = 0.0f;
    state->at = 0;
    forget(table, state);
}

static int is_valid(const tact_touch *table)
{
    return table->feedback_count >= 1 && table->feedback_count <= TACT_TOUCH_FEEDBACK_MAX && table->delay >= 1 &&
           table->delay <= TACT_TOUCH_DELAY_MAX && table->turns >= 1 && table->turn >= 0 &&
           table->turn < table->turns && table->hum_count >= 0 && table->hum_count <= TACT_TOUCH_HUM_MAX &&
           table->push_max_v >= 0.0f && table->weight_max >= 0.0f && table->ridge > 0.0f && table->gate > 0.0f &&
           table->forgetting >= 0.0f && (float)TACT_TOUCH_LEVEL_RATE * table->forgetting <= 1.0f;
}

int tact_touch_settle(tact_touch *table)
{
    if (!is_valid(table))
        return 0;
    table->until_hum = table->turn + 1;
    table->until_learning = table->turns - table->until_hum;
    table->soon = (float)TACT_TOUCH_LEVEL_RATE * table->forgetting;
    return 1;
}
