/* Second-order section in delta form, float32.
 *
 *            b0 d^2 + b1 d + b2
 *     H(z) = ------------------,   d = z - 1
 *             d^2 + a1 d + a2
 *
 *   x ---+--------[b0]--------(+)----------------------------------+---> y
 *        |                     ^ s1                                |
 *        |              +------+------+                            |
 *        |              | accumulator | s1 += b1 x - a1 y + s2     |
 *        |              +------^------+                            |
 *        |                     | s2                                |
 *        |              +------+------+                            |
 *        +--------------| accumulator | s2 += b2 x - a2 y ---------+
 *                       +-------------+
 *
 * Poles of a slow filter crowd at z = 1, where 1 + a1 z^-1 + a2 z^-2 is a small difference of large numbers. In d the
 * same filter has small coefficients that keep all their digits: 200 times less round-off than a direct form for two
 * additions more (Goodall & Donoghue 1993; Middleton & Goodwin 1990, chapter 2).
 *
 * In a row of sections whose input is zero, states below TACT_TINY are set to zero, so that silence never decays into
 * subnormal numbers. Written without a fused multiply-add, each product rounded: compile with -ffp-contract=off.
 *
 * Example use:
 *   tact_section section = {1.0f, 0.0f, 0.0f, 0.0f, 0.0f};
 *   tact_section_state state = {0.0f, 0.0f};
 *   float y = tact_section_step(&section, &state, x);
 */
#ifndef TACT_SECTION_H
#define TACT_SECTION_H

#include <stdint.h>

#include "arithmetic/finite.h"

typedef struct {
    float b0, b1, b2, a1, a2;
} tact_section;

typedef struct {
    float s1, s2;
} tact_section_state;

/* One sample through one section. */
static inline float tact_section_step(const tact_section *section, tact_section_state *state, float x)
{
    const float s1 = state->s1, s2 = state->s2, y = section->b0 * x + s1;
    state->s1 = s1 + ((section->b1 * x - section->a1 * y) + s2);
    state->s2 = s2 + (section->b2 * x - section->a2 * y);
    return y;
}

/* Sections in a row whose input is zero: those whose states have decayed come to rest, one after another. */
void tact_sections_rest(tact_section_state *state, int32_t count);

/* One sample through `count` sections in a row. */
static inline float tact_sections_step(const tact_section *section, tact_section_state *state, int32_t count, float x)
{
    float y = x;
    for (int32_t i = 0; i < count; i++)
        y = tact_section_step(&section[i], &state[i], y);
    if (x == 0.0f)
        tact_sections_rest(state, count);
    return y;
}

/* Changes the states as one sample with an input greater by x would have; returns the change of y. */
static inline float tact_section_shift(const tact_section *section, tact_section_state *state, float x)
{
    const float y = section->b0 * x;
    state->s1 += section->b1 * x - section->a1 * y;
    state->s2 += section->b2 * x - section->a2 * y;
    return y;
}

#endif
