/* Second-order section in delta form, Q31: for processors without a floating-point unit.
 *
 * The diagram of section.h in integers. Signals are int32 (Q31: full scale is 2^31), the two accumulators int64 with
 * 21 bits more (Q52):
 *
 *     y   = round((s1 + b0 x) / 2^21), saturated to int32
 *     s1 += (b1 x - a1 y) + s2
 *     s2 += (b2 x - a2 y)
 *
 * What rounding takes from y stays in s1: the error is fed back exactly, and no more than the last bit of y is ever
 * wrong. Coefficients are int32 with one shift to a row, c = mantissa / 2^(21 + shift): the small numbers of a slow
 * filter's delta form keep 31 significant bits. Shifts are 2 to 62 and no mantissa is -2^31, so |c| < 256. The
 * accumulators stop at +/- 2^61, 512 full scales.
 *
 * Example use:
 *   tact_section_q31 section = {1 << 30, 0, 0, 0, 0, 9, 2, 2};         (b0 = 1)
 *   tact_section_q31_state state = {0, 0};
 *   int32_t y = tact_section_q31_step(&section, &state, x);
 */
#ifndef TACT_SECTION_Q31_H
#define TACT_SECTION_Q31_H

#include <stddef.h>
#include <stdint.h>

enum { TACT_Q31_EXTRA = 21, TACT_Q31_SHIFT_MIN = 2, TACT_Q31_SHIFT_MAX = 62 };

typedef struct {
    int32_t b0, b1, b2, a1, a2;
    uint8_t shift0, shift1, shift2, unused; /* of b0; of b1 and a1; of b2 and a2 */
} tact_section_q31;

typedef struct {
    int64_t s1, s2;
} tact_section_q31_state;

/* Within +/- 2^61: seen from the upper half alone, as below. */
inline int64_t tact_q31_bounded(int64_t state)
{
    const int64_t most = (int64_t)1 << 61;
    const int32_t high = (int32_t)(state >> 32);
    if ((uint32_t)high + 0x20000000u < 0x40000000u)
        return state;
    return high < 0 ? -most : most;
}

inline int32_t tact_q31_saturated(int64_t value)
{
    const int64_t below = value > INT32_MAX ? INT32_MAX : value;
    return (int32_t)(below < INT32_MIN ? INT32_MIN : below);
}

/* sum / 2^21, rounded, saturated. */
inline int32_t tact_q31_rounded(int64_t sum)
{
    const int64_t value = sum + ((int64_t)1 << (TACT_Q31_EXTRA - 1));
    const int32_t high = (int32_t)(value >> 32);
    const int32_t inside = (int32_t)(uint32_t)(value >> TACT_Q31_EXTRA);
    const int32_t most = (high >> 31) ^ INT32_MAX; /* of its sign */
    return (uint32_t)high + 0x100000u < 0x200000u ? inside : most;
}

/* One sample through one section. A right shift of a negative number rounds down (gcc and clang: arithmetic). */
inline int32_t tact_section_q31_step(const tact_section_q31 *section, tact_section_q31_state *state, int32_t x)
{
    const int64_t s1 = state->s1, s2 = state->s2;
    const int32_t y = tact_q31_rounded(s1 + (((int64_t)section->b0 * x) >> section->shift0));
    const int64_t first = ((int64_t)section->b1 * x + (int64_t)-section->a1 * y) >> section->shift1;
    const int64_t second = ((int64_t)section->b2 * x + (int64_t)-section->a2 * y) >> section->shift2;
    state->s1 = tact_q31_bounded(s1 + (first + s2));
    state->s2 = tact_q31_bounded(s2 + second);
    return y;
}

/* Changes the states as one sample with an input greater by x would have, as tact_section_shift() does. */
inline int32_t tact_section_q31_shift(const tact_section_q31 *section, tact_section_q31_state *state, int32_t x)
{
    tact_section_q31_state change = {0, 0};
    const int32_t y = tact_section_q31_step(section, &change, x);
    state->s1 = tact_q31_bounded(state->s1 + change.s1);
    state->s2 = tact_q31_bounded(state->s2 + change.s2);
    return y;
}

/* samples of x through a cascade of count sections into y (which may be x). */
void tact_cascade_q31_run(const tact_section_q31 *sections, tact_section_q31_state *states, int count,
                          const int32_t *x, int32_t *y, size_t samples);

#endif
