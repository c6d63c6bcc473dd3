/* Two neighbouring floats, read at once.
 *
 * A processor whose single-precision registers are halves of double-precision ones (Cortex-M4F, M7) moves both by one
 * instruction, and the compiler sees to it when they are copied as one double: that halves the loads of a filter. The
 * bits are only copied; no arithmetic in double takes place.
 *
 *     address, a multiple of 8:  | first | second |  <-->  one register of 64 bits = two of 32
 *
 * Example use:
 *   const tact_float_pair state = tact_float_pair_get(&section_state);
 *   float y = b0 * x + state.first;
 */
#ifndef TACT_FLOAT_PAIR_H
#define TACT_FLOAT_PAIR_H

typedef struct {
    float first, second;
} tact_float_pair;

/* The two floats at an address that is a multiple of 8. */
static inline tact_float_pair tact_float_pair_get(const void *at)
{
    typedef double __attribute__((__may_alias__)) whole;
    const union {
        double both;
        tact_float_pair pair;
    } copy = {*(const whole *)at};
    return copy.pair;
}

/* Copies the two floats at one multiple of 8 to another. */
static inline void tact_float_pair_copy(void *to, const void *from)
{
    typedef double __attribute__((__may_alias__)) whole;
    *(whole *)to = *(const whole *)from;
}

#endif
