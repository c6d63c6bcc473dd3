#include "touch/learning.h"

static float within(float value, float lowest, float highest)
{
    const float cut = value > highest ? highest : value;
    return cut < lowest ? lowest : cut;
}

/* What is left when a slow part is taken off. */
static float quick(float slow, float *part, float x)
{
    *part += slow * (x - *part);
    return x - *part;
}

/* The poles' content times the plant's numerator, and its denominator: d past[2] = corner (past[1] - past[2]). */
static float forced(const tact_touch *table, const tact_touch_poles *poles)
{
    return poles->past[2] + table->force * (poles->past[1] - poles->past[2]);
}

static float inverted(const tact_touch *table, const tact_touch_poles *poles)
{
    const float first = poles->past[0] - poles->past[1], second = poles->past[1] - poles->past[2];
    return table->inverse[0] * (first - second) + (table->inverse[1] * second + table->inverse[2] * poles->past[2]);
}

/* The hum at this turn. */
static float hum_next(const tact_touch *table, tact_touch_state *state)
{
    float sum = 0.0f;
    for (int32_t i = 0; i < table->hum_count; i++) {
        const float c = table->hum[i][0], s = table->hum[i][1];
        float *hum = state->hum[i];
        const float cosine = hum[0] * c - hum[1] * s, sine = hum[1] * c + hum[0] * s;
        const float gain = 1.5f - 0.5f * (cosine * cosine + sine * sine);
        hum[0] = cosine * gain;
        hum[1] = sine * gain;
        sum += hum[2] * hum[0] + hum[3] * hum[1];
    }
    return sum;
}

static void hum_learn(const tact_touch *table, tact_touch_state *state, float left)
{
    for (int32_t i = 0; i < table->hum_count; i++) {
        float *hum = state->hum[i];
        hum[2] += table->hum_gain * left * hum[0];
        hum[3] += table->hum_gain * left * hum[1];
    }
}

static float towards(float from, float to, float slew)
{
    return from + within(to - from, -slew, slew);
}

/* Least squares on two pushes, whose squares hold the ridge; a weight that is no number is seen by its caller. */
static void solve(const tact_touch *table, tact_touch_state *state)
{
    const float lean = table->shape * (state->square[0] + state->square[2]);
    const float a = state->square[0] + lean, c = state->square[2] + lean;
    const float b = state->square[1] - lean;
    const float one = 1.0f / (a * c - b * b), most = table->weight_max;
    const float first = (c * state->product[0] - b * state->product[1]) * one;
    const float second = (a * state->product[1] - b * state->product[0]) * one;
    state->weight[0] = towards(state->weight[0], within(first, 0.0f, most), table->slew);
    state->weight[1] = towards(state->weight[1], within(second, 0.0f, most), table->slew);
}

/* Each turn counts by its level now, so that what was loud a moment ago does not outweigh what is heard after it. */
static void accumulate(const tact_touch *table, tact_touch_state *state, float force, float first, float second)
{
    const float now = first * first + second * second;
    state->power += table->forgetting * (now - state->power);
    state->level += (float)TACT_TOUCH_LEVEL_RATE * table->forgetting * (now - state->level);
    const float share = state->power / (state->power + table->gate), one = 1.0f / (state->level + table->gate);
    const float rate = table->forgetting * share, kept = 1.0f - table->fading * (1.0f - share);
    const float ridge = one * table->ridge, x = one * first, y = one * second;
    state->square[0] += rate * ((first * x + ridge) - state->square[0]);
    state->square[1] += rate * (first * y - state->square[1]);
    state->square[2] += rate * ((second * y + ridge) - state->square[2]);
    state->product[0] = kept * (state->product[0] + rate * (x * force - state->product[0]));
    state->product[1] = kept * (state->product[1] + rate * (y * force - state->product[1]));
}

/* Numbers that silence would let decay until they are subnormal. */
static void see_to_silence(tact_touch_state *state, float first, float second)
{
    float *part[] = {&state->power, &state->level, &state->product[0], &state->product[1], &state->square[1]};
    for (int i = 0; i < 5; i++)
        *part[i] = __builtin_fabsf(*part[i]) < TACT_TINY ? 0.0f : *part[i];
    for (int i = 0; i < 3; i++) {
        state->command.past[i] = __builtin_fabsf(state->command.past[i]) < TACT_TINY ? 0.0f : state->command.past[i];
        state->position.past[i] = __builtin_fabsf(state->position.past[i]) < TACT_TINY ? 0.0f : state->position.past[i];
        state->slow[i] = __builtin_fabsf(state->slow[i]) < TACT_TINY ? 0.0f : state->slow[i];
    }
    for (int i = 0; i < TACT_TOUCH_HUM_MAX; i++)
        for (int j = 2; j < 4; j++)
            state->hum[i][j] = __builtin_fabsf(state->hum[i][j]) < TACT_TINY ? 0.0f : state->hum[i][j];
    if (__builtin_fabsf(state->plant.s1) < TACT_TOUCH_SILENT && __builtin_fabsf(state->plant.s2) < TACT_TOUCH_SILENT &&
        __builtin_fabsf(first) < TACT_TOUCH_SILENT && __builtin_fabsf(second) < TACT_TOUCH_SILENT)
        tact_touch_rest_model(state);
}

void tact_touch_learn(const tact_touch *table, tact_touch_state *state)
{
    const float balance = forced(table, &state->command) - inverted(table, &state->position);
    const float force = quick(table->slow, &state->slow[0], balance);
    float first = quick(table->slow, &state->slow[1], forced(table, &state->push[0]));
    float second = quick(table->slow, &state->slow[2], forced(table, &state->push[1]));
    state->count = 0;
    if (__builtin_fabsf(first) < TACT_TOUCH_SILENT && __builtin_fabsf(second) < TACT_TOUCH_SILENT) {
        see_to_silence(state, first, second);
        first = second = 0.0f;
    }
    const float heard = force - hum_next(table, state);
    hum_learn(table, state, heard - (state->weight[0] * first + state->weight[1] * second));
    accumulate(table, state, heard, first, second);
    solve(table, state);
    if (!(state->weight[0] >= 0.0f && state->weight[0] <= table->weight_max && state->weight[1] >= 0.0f &&
          state->weight[1] <= table->weight_max))
        tact_touch_reset(table, state);
}
