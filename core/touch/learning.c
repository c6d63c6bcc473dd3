#include "touch/learning.h"

static inline float within(float value, float lowest, float highest)
{
    const float cut = value > highest ? highest : value;
    return cut < lowest ? lowest : cut;
}

/* The hum at the next turn, from what it is now. */
static void hum_turn(const tact_touch *table, tact_touch_state *state)
{
    float sum = 0.0f;
    for (int32_t i = 0; i < table->hum_count; i++) {
        const float c = table->hum[i][0], s = table->hum[i][1], now = state->hum[i][0], before = state->hum[i][1];
        const float next = now * c - before * s;
        state->turned[i][0] = next;
        state->turned[i][1] = before * c + now * s;
        sum += next;
    }
    state->hummed = sum;
}

/* One line of it, with what the last turn learnt, and then turned. */
static inline float turned(const float *turn, float *line, float *on, float share)
{
    const tact_float_pair k = tact_float_pair_get(turn), last = tact_float_pair_get(on);
    const float now = last.first + share, before = last.second;
    const float next = now * k.first - before * k.second;
    line[0] = now;
    line[1] = before;
    on[0] = next;
    on[1] = before * k.first + now * k.second;
    return next;
}

/* What learning leaves for a tick in which no channel learns. Lines stand one by one: to count them would cost more. */
static inline void hum_learn(const tact_touch *table, tact_touch_state *state)
{
    const int32_t lines = table->hum_count;
    const float share = state->hum_learnt;
    float sum = 0.0f;
    if (lines > 0)
        sum = turned(table->hum[0], state->hum[0], state->turned[0], share);
    if (lines > 1)
        sum += turned(table->hum[1], state->hum[1], state->turned[1], share);
    if (lines > 2)
        sum += turned(table->hum[2], state->hum[2], state->turned[2], share);
    if (lines > 3)
        sum += turned(table->hum[3], state->hum[3], state->turned[3], share);
    state->hummed = sum;
    state->is_due = 0;
    state->left = table->until_learning;
}

/* One weight on the way to where it shall be. */
static inline float moved(float from, float to, float most, float slew)
{
    return within(from + within(to - from, -slew, slew), 0.0f, most);
}

/* What the weights make of the figures that every sample needs. */
static inline void weigh(const tact_touch *table, tact_touch_state *state, float first, float second, float mass)
{
    const tact_float_pair m = tact_float_pair_get(&table->mass[1]), r = tact_float_pair_get(table->rest);
    state->weight[0] = first;
    state->weight[1] = second;
    state->by_command = first * mass;
    state->by_change = second * r.first - first * m.first;
    state->by_place = second * r.second - first * m.second;
}

/* One turn from the finger's force and both pushes on. Each turn counts by its level now, so that what was loud a moment
 * ago does not outweigh what is heard after it. Then least squares on two pushes, whose squares hold the ridge; a weight
 * that is no number ends all that was learnt. */
static inline __attribute__((always_inline)) void learn_from(const tact_touch *table, tact_touch_state *state,
                                                             float force, float first, float second,
                                                             float hum_gain)
{
    const tact_float_pair weight = tact_float_pair_get(state->weight), loud = tact_float_pair_get(&state->power);
    const tact_float_pair s0 = tact_float_pair_get(state->square), s1 = tact_float_pair_get(&state->square[2]);
    const tact_float_pair forgetting = tact_float_pair_get(&table->forgetting), least = tact_float_pair_get(&table->gate);
    const tact_float_pair shape = tact_float_pair_get(&table->shape);
    const float heard = force - state->hummed, gate = least.first;
    const float now = first * first + second * second;
    const float power = loud.first + forgetting.first * (now - loud.first);
    const float level = loud.second + forgetting.second * (now - loud.second);
    const float share = power / (power + gate), one = 1.0f / (level + gate);
    const float rate = forgetting.first * share, kept = 1.0f - shape.second * (1.0f - share);
    const float ridge = one * least.second, x = one * first, y = one * second;
    const float xx = s0.first + rate * ((first * x + ridge) - s0.first), xy = s0.second + rate * (first * y - s0.second);
    const float yy = s1.first + rate * ((second * y + ridge) - s1.first);
    const float px = kept * (s1.second + rate * (x * heard - s1.second));
    const float py = kept * (state->product[1] + rate * (y * heard - state->product[1]));
    const float lean = shape.first * (xx + yy), a = xx + lean, c = yy + lean, b = xy - lean;
    const tact_float_pair slew_mass = tact_float_pair_get(&table->slew);
    const float by = 1.0f / (a * c - b * b), most = table->weight_max, slew = slew_mass.first;
    const float to_first = (c * px - b * py) * by, to_second = (a * py - b * px) * by;
    state->hum_learnt = hum_gain * (heard - (weight.first * first + weight.second * second));
    state->power = power;
    state->level = level;
    state->square[0] = xx;
    state->square[1] = xy;
    state->square[2] = yy;
    state->product[0] = px;
    state->product[1] = py;
    state->is_due = 1;
    state->left = table->until_hum;
    const float w0 = moved(weight.first, to_first, most, slew), w1 = moved(weight.second, to_second, most, slew);
    if (w0 + w1 <= most + most)
        weigh(table, state, w0, w1, slew_mass.second);
    else
        tact_touch_reset(table, state);
}

static inline void end_if_tiny(float *parts, int count)
{
    for (int i = 0; i < count; i++)
        parts[i] = __builtin_fabsf(parts[i]) < TACT_TINY ? 0.0f : parts[i];
}

/* Numbers that silence would let decay until they are subnormal. */
static void see_to_silence(tact_touch_state *state)
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

static __attribute__((noinline)) void learn_in_silence(const tact_touch *table, tact_touch_state *state, float force)
{
    see_to_silence(state);
    hum_turn(table, state);
    learn_from(table, state, force, 0.0f, 0.0f, table->hum_gain);
}

static __attribute__((noinline)) void learn(const tact_touch *table, tact_touch_state *state)
{
    const tact_float_pair p0 = tact_float_pair_get(&state->balance[2]), p1 = tact_float_pair_get(&state->model[1]);
    const tact_float_pair k0 = tact_float_pair_get(&table->slow), k1 = tact_float_pair_get(&table->first[1]);
    const tact_float_pair k2 = tact_float_pair_get(table->second), k3 = tact_float_pair_get(&table->second[2]);
    const tact_float_pair slow = tact_float_pair_get(state->slow);
    /* the model's three poles, summed */
    const float change = p1.first - p1.second, bend = (p0.second - p1.first) - change;
    const float pushed = k0.second * bend + (k1.first * change + k1.second * p1.second);
    const float held = k2.first * bend + (k2.second * change + k3.first * p1.second);
    const float by = k0.first, third = state->slow[2];
    const float force_slow = slow.first + by * (p0.first - slow.first);
    const float first_slow = slow.second + by * (pushed - slow.second), second_slow = third + by * (held - third);
    const float force = p0.first - force_slow, first = pushed - first_slow, second = held - second_slow;
    state->slow[0] = force_slow;
    state->slow[1] = first_slow;
    state->slow[2] = second_slow;
    if (__builtin_fabsf(first) < TACT_TOUCH_SILENT && __builtin_fabsf(second) < TACT_TOUCH_SILENT)
        learn_in_silence(table, state, force);
    else
        learn_from(table, state, force, first, second, k3.second);
}

void tact_touch_learn(const tact_touch *table, tact_touch_state *state)
{
    if (state->is_due) {
        hum_learn(table, state);
        if (state->left > 0)
            return;
    }
    learn(table, state);
}
