#include "touch/learning.h"

static inline float within(float value, float lowest, float highest)
{
    const float cut = value > highest ? highest : value;
    return cut < lowest ? lowest : cut;
}

/* What is left when a slow part is taken off. */
static inline float quick(float slow, float *part, float x)
{
    const float moved = *part + slow * (x - *part);
    *part = moved;
    return x - moved;
}

/* The model's three poles, summed. */
static inline float summed(const float *by, const float *poles)
{
    const float change = poles[1] - poles[2], second = (poles[0] - poles[1]) - change;
    return by[0] * second + (by[1] * change + by[2] * poles[2]);
}

/* The hum at this turn. */
static inline float hum_next(const tact_touch *table, tact_touch_state *state)
{
    float sum = 0.0f;
    for (int32_t i = 0; i < table->hum_count; i++) {
        const float c = table->hum[i][0], s = table->hum[i][1], now = state->hum[i][0], before = state->hum[i][1];
        const float next = now * c - before * s;
        state->hum[i][0] = next;
        state->hum[i][1] = before * c + now * s;
        sum += next;
    }
    return sum;
}

static inline void hum_learn(const tact_touch *table, tact_touch_state *state, float left)
{
    const float share = table->hum_gain * left;
    for (int32_t i = 0; i < table->hum_count; i++)
        state->hum[i][0] += share;
}

/* One weight on the way to where it shall be. */
static inline float moved(float from, float to, float most, float slew)
{
    return within(from + within(to - from, -slew, slew), 0.0f, most);
}

/* What the weights make of the figures that every sample needs. */
static inline void weigh(const tact_touch *table, tact_touch_state *state, float first, float second)
{
    state->weight[0] = first;
    state->weight[1] = second;
    state->by_command = first * table->mass[0];
    state->by_change = second * table->rest[0] - first * table->mass[1];
    state->by_place = second * table->rest[1] - first * table->mass[2];
}

/* Least squares on two pushes, whose squares hold the ridge; a weight that is no number ends all that was learnt. */
static inline void solve(const tact_touch *table, tact_touch_state *state)
{
    const float lean = table->shape * (state->square[0] + state->square[2]);
    const float a = state->square[0] + lean, c = state->square[2] + lean, b = state->square[1] - lean;
    const float one = 1.0f / (a * c - b * b), most = table->weight_max, slew = table->slew;
    const float to_first = (c * state->product[0] - b * state->product[1]) * one;
    const float to_second = (a * state->product[1] - b * state->product[0]) * one;
    const float first = moved(state->weight[0], to_first, most, slew);
    const float second = moved(state->weight[1], to_second, most, slew);
    if (first + second <= most + most)
        weigh(table, state, first, second);
    else
        tact_touch_reset(table, state);
}

/* Each turn counts by its level now, so that what was loud a moment ago does not outweigh what is heard after it. */
static inline void accumulate(const tact_touch *table, tact_touch_state *state, float force, float first, float second)
{
    const float forgetting = table->forgetting, gate = table->gate;
    const float now = first * first + second * second;
    const float power = state->power + forgetting * (now - state->power);
    const float level = state->level + (float)TACT_TOUCH_LEVEL_RATE * forgetting * (now - state->level);
    const float share = power / (power + gate), one = 1.0f / (level + gate);
    const float rate = forgetting * share, kept = 1.0f - table->fading * (1.0f - share);
    const float ridge = one * table->ridge, x = one * first, y = one * second;
    state->power = power;
    state->level = level;
    state->square[0] += rate * ((first * x + ridge) - state->square[0]);
    state->square[1] += rate * (first * y - state->square[1]);
    state->square[2] += rate * ((second * y + ridge) - state->square[2]);
    state->product[0] = kept * (state->product[0] + rate * (x * force - state->product[0]));
    state->product[1] = kept * (state->product[1] + rate * (y * force - state->product[1]));
}

static inline void end_if_tiny(float *parts, int count)
{
    for (int i = 0; i < count; i++)
        parts[i] = __builtin_fabsf(parts[i]) < TACT_TINY ? 0.0f : parts[i];
}

/* Numbers that silence would let decay until they are subnormal. */
static __attribute__((noinline)) void see_to_silence(tact_touch_state *state)
{
    end_if_tiny(&state->power, 1);
    end_if_tiny(&state->level, 1);
    end_if_tiny(state->product, 2);
    end_if_tiny(&state->square[1], 1);
    end_if_tiny(state->balance, 3);
    end_if_tiny(state->slow, 3);
    for (int i = 0; i < TACT_TOUCH_HUM_MAX; i++)
        end_if_tiny(state->hum[i], 2);
    if (__builtin_fabsf(state->plant.s1) < TACT_TOUCH_SILENT && __builtin_fabsf(state->plant.s2) < TACT_TOUCH_SILENT)
        tact_touch_rest_model(state);
}

void tact_touch_learn(const tact_touch *table, tact_touch_state *state)
{
    const float force = quick(table->slow, &state->slow[0], state->balance[2]);
    float first = quick(table->slow, &state->slow[1], summed(table->first, state->model));
    float second = quick(table->slow, &state->slow[2], summed(table->second, state->model));
    state->count = 0;
    if (__builtin_fabsf(first) < TACT_TOUCH_SILENT && __builtin_fabsf(second) < TACT_TOUCH_SILENT) {
        see_to_silence(state);
        first = second = 0.0f;
    }
    const float heard = force - hum_next(table, state);
    hum_learn(table, state, heard - (state->weight[0] * first + state->weight[1] * second));
    accumulate(table, state, heard, first, second);
    solve(table, state);
}
