#include "touch/learning.h"

#define SILENT 1e-12f /* volts: less is nothing */

static float within(float value, float lowest, float highest)
{
    const float cut = value > highest ? highest : value;
    return cut < lowest ? lowest : cut;
}

/* One weight on the way to where it shall be. */
static float moved(float from, float to, float most, float slew)
{
    return within(from + within(to - from, -slew, slew), 0.0f, most);
}

static int is_tiny(float value, float tiny)
{
    return __builtin_fabsf(value) < tiny;
}

static void end_if_tiny(float *parts, int count)
{
    for (int i = 0; i < count; i++)
        parts[i] = is_tiny(parts[i], TACT_TINY) ? 0.0f : parts[i];
}

/* Numbers that silence would let decay until they are subnormal. */
static void end_what_decays(tact_touch_state *state)
{
    end_if_tiny(&state->power, 1);
    end_if_tiny(&state->level, 1);
    end_if_tiny(state->product, 2);
    end_if_tiny(&state->square[1], 1);
    end_if_tiny(state->balance, 3);
    end_if_tiny(state->slow, 3);
    end_if_tiny(state->hum[0], 2 * TACT_TOUCH_HUM_MAX);
    if (is_tiny(state->plant.s1, SILENT) && is_tiny(state->plant.s2, SILENT))
        tact_touch_rest_model(state);
}

/* What is quick in a value. */
static float quick(float share, float *slow, float value)
{
    *slow += share * (value - *slow);
    return value - *slow;
}

/* Every line of the hum, with what was learnt at the last turn, a turn on; their sum. */
static float turn_hum(const tact_touch *table, tact_touch_state *state)
{
    float sum = 0.0f;
    for (int32_t i = 0; i < table->hum_count; i++) {
        const float cosine = table->hum[i][0], sine = table->hum[i][1];
        const float now = state->hum[i][0] + state->hum_learnt, before = state->hum[i][1];
        state->hum[i][0] = now * cosine - before * sine;
        state->hum[i][1] = before * cosine + now * sine;
        sum += state->hum[i][0];
    }
    return sum;
}

/* The weights, and what they make of the figures that every sample needs. A weight that is no number ends all. */
static void weigh(const tact_touch *table, tact_touch_state *state, float first, float second)
{
    const float *const mass = table->mass, *const rest = table->rest;
    if (!(first + second <= 2.0f * table->weight_max)) {
        tact_touch_reset(table, state);
        return;
    }
    state->weight[0] = first;
    state->weight[1] = second;
    state->by_command = first * mass[0];
    state->by_change = second * rest[0] - first * mass[1];
    state->by_place = second * rest[1] - first * mass[2];
}

void tact_touch_learn(const tact_touch *table, tact_touch_state *state)
{
    const float *const a1 = table->first, *const a2 = table->second, *const model = state->model;
    const float place = model[2], change = model[1] - place, bend = (model[0] - model[1]) - change;
    const float force = quick(table->slow, &state->slow[0], state->balance[2]);
    float first = quick(table->slow, &state->slow[1], a1[0] * bend + (a1[1] * change + a1[2] * place));
    float second = quick(table->slow, &state->slow[2], a2[0] * bend + (a2[1] * change + a2[2] * place));
    if (is_tiny(first, SILENT) && is_tiny(second, SILENT)) {
        first = second = 0.0f;
        end_what_decays(state);
    }
    const float heard = force - turn_hum(table, state);
    const float now = first * first + second * second, forgetting = table->forgetting;
    state->power += forgetting * (now - state->power);
    state->level += (float)TACT_TOUCH_LEVEL_RATE * forgetting * (now - state->level);
    /* each turn counts by its level: what was loud a moment ago does not outweigh what is heard after it */
    const float share = state->power / (state->power + table->gate), one = 1.0f / (state->level + table->gate);
    const float rate = forgetting * share, kept = 1.0f - table->fading * (1.0f - share);
    const float x = one * first, y = one * second, ridge = one * table->ridge;
    float *const square = state->square, *const product = state->product;
    square[0] += rate * ((first * x + ridge) - square[0]);
    square[1] += rate * (first * y - square[1]);
    square[2] += rate * ((second * y + ridge) - square[2]);
    product[0] = kept * (product[0] + rate * (x * heard - product[0]));
    product[1] = kept * (product[1] + rate * (y * heard - product[1]));
    /* least squares on both pushes, leaning towards equal weights */
    const float lean = table->shape * (square[0] + square[2]);
    const float a = square[0] + lean, b = square[1] - lean, c = square[2] + lean, by = 1.0f / (a * c - b * b);
    state->hum_learnt = table->hum_gain * (heard - (state->weight[0] * first + state->weight[1] * second));
    state->left = table->turns;
    weigh(table, state, moved(state->weight[0], (c * product[0] - b * product[1]) * by, table->weight_max, table->slew),
          moved(state->weight[1], (a * product[1] - b * product[0]) * by, table->weight_max, table->slew));
}
