#include "strength/strength.h"

#include "control/controller.h"

#define GAIN_MAX 1e4f
#define QUIET 1e-12f  /* power below which there is time for rest */
#define SILENT 1e-20f /* what a pair holds then is nothing */
#define FELT 0.5f     /* power of a tone at threshold, where the rows begin */
#define RISE 6.0f     /* the level rises by no more than this times `follow` of itself in a sample */

enum { EXPONENT_BIAS = 127, MANTISSA_BITS = 23, MANTISSA_MASK = 0x7fffff, OF_ONE = 0x3f800000 };

typedef union {
    float number;
    uint32_t bits;
} same_bits;

typedef struct {
    const float *low, *high;
    float share; /* of the way from low to high */
} blend;

static blend blend_at(const tact_strength *table, float power)
{
    const same_bits whole = {power};
    const int32_t row = (int32_t)(whole.bits >> MANTISSA_BITS) - EXPONENT_BIAS - TACT_STRENGTH_FIRST;
    const same_bits part = {.bits = (whole.bits & MANTISSA_MASK) | OF_ONE};
    if (row < 0)
        return (blend){table->gain[0], table->gain[0], 0.0f};
    if (row >= TACT_STRENGTH_LEVELS - 1)
        return (blend){table->gain[TACT_STRENGTH_LEVELS - 1], table->gain[TACT_STRENGTH_LEVELS - 1], 0.0f};
    return (blend){table->gain[row], table->gain[row + 1], part.number - 1.0f};
}

static inline float gain_at(const blend *at, int i)
{
    return at->low[i] + at->share * (at->high[i] - at->low[i]);
}

/* Silence never decays into subnormal numbers. */
static void come_to_rest(tact_strength_state *state)
{
    state->power = tact_finite(state->power, TACT_REFERENCE_MAX * TACT_REFERENCE_MAX);
    state->level = tact_finite(state->level, TACT_REFERENCE_MAX * TACT_REFERENCE_MAX);
    for (int i = 0; i < TACT_STRENGTH_PAIRS; i++)
        for (int k = 0; k < 2; k++)
            if (state->pair[i][k] < SILENT && state->pair[i][k] > -SILENT)
                state->pair[i][k] = 0.0f;
}

void tact_strength_reset(tact_strength_state *state)
{
    state->power = state->level = 0.0f;
    for (int i = 0; i < TACT_STRENGTH_PAIRS; i++)
        state->pair[i][0] = state->pair[i][1] = 0.0f;
}

float tact_strength_step(const tact_strength *table, tact_strength_state *state, float reference)
{
    const float r = tact_finite(reference, TACT_REFERENCE_MAX);
    state->power += table->follow * (r * r - state->power);
    const float felt = state->level > FELT ? state->level : FELT;
    const float most = felt + RISE * table->follow * felt, next = state->level + table->follow * (state->power - state->level);
    state->level = next < most ? next : most;
    const blend at = blend_at(table, state->level);
    float sum = gain_at(&at, 0) * r;
    for (int i = 0; i < TACT_STRENGTH_PAIRS; i++) {
        float *const pair = state->pair[i];
        const float moved = pair[0] + table->turn[i] * ((r - pair[1]) - table->damping * pair[0]);
        const float band = (moved >= TACT_TINY) | (moved <= -TACT_TINY) ? moved : 0.0f; /* a constant leaves it silent */
        const float low = pair[1] + table->turn[i] * band;
        pair[0] = band;
        pair[1] = low;
        sum += gain_at(&at, 2 * i + 1) * band + gain_at(&at, 2 * i + 2) * low;
    }
    if (state->level < QUIET)
        come_to_rest(state);
    return sum;
}

/* Jury's conditions for z^2 - (2 - t d - t^2) z + 1 - t d. */
static int is_stable(float turn, float damping)
{
    const float lost = turn * damping;
    return turn > 0.0f && lost > 0.0f && lost < 2.0f && 2.0f * lost + turn * turn < 4.0f;
}

int tact_strength_is_valid(const tact_strength *table)
{
    int valid = table->follow > 0.0f && table->follow < 1.0f;
    for (int i = 0; i < TACT_STRENGTH_PAIRS; i++)
        valid &= is_stable(table->turn[i], table->damping);
    for (int row = 0; row < TACT_STRENGTH_LEVELS; row++)
        for (int i = 0; i < TACT_STRENGTH_GAINS; i++)
            valid &= table->gain[row][i] < GAIN_MAX && table->gain[row][i] > -GAIN_MAX; /* NaN fails both */
    return valid;
}
