/* A reference reshaped by its own short-time level, so that equal references are equally strong.
 *
 *     r --+-------------------------(x gain)--+
 *         +--[ pair 1 ]--> band, low (x gains)--+---> what the prefilter gets
 *         +--[ pair 2 ]--> band, low (x gains)--+
 *         |     ...                   ^
 *         +--[ ^2 ]--[ two poles ]----+  power: which row of gains, and how far towards the next
 *
 * The prefilters of all levels share their poles, in pairs, and differ in the gains alone: a row of gains for each
 * doubling of the power from 2^TACT_STRENGTH_FIRST on (a tone of amplitude 1, at threshold, has the power 2^-1). Between
 * two rows the gains are blended in proportion to the power, below the first and above the last row they are held. One
 * filter is run, whatever the number of levels; the row is the power's exponent, so that no logarithm is taken.
 *
 * What begins does not step: the level rises from threshold by 0.13 dB in a sample at the most (4 kHz, 50 ms).
 *
 * A pair: band += turn (r - low - damping band), then low += turn band: a band-pass and a low-pass of one corner.
 *
 * It acts where references come in, before they are limited to comfort and travel, and outside of the interrupt.
 *
 * Example use:
 *   tact_strength_reset(&state);
 *   float reshaped = tact_strength_step(&table, &state, reference);
 */
#ifndef TACT_STRENGTH_H
#define TACT_STRENGTH_H

#include <stdint.h>

#include "arithmetic/finite.h"

enum { TACT_STRENGTH_PAIRS = 4, TACT_STRENGTH_GAINS = 1 + 2 * TACT_STRENGTH_PAIRS, TACT_STRENGTH_LEVELS = 21, TACT_STRENGTH_FIRST = -1 };

typedef struct {
    int32_t is_on;                   /* 0: nothing is reshaped */
    float follow;                    /* share of the new that each of the level's two poles takes in a sample */
    float damping;                   /* of every pair */
    float turn[TACT_STRENGTH_PAIRS]; /* 2 sin(pi f T) of each corner f */
    float gain[TACT_STRENGTH_LEVELS][TACT_STRENGTH_GAINS]; /* of the reference itself, then of each pair's band and low */
} tact_strength;

typedef struct {
    float power, level; /* what the level's two poles hold */
    float pair[TACT_STRENGTH_PAIRS][2]; /* band, low */
} tact_strength_state;

/* Nothing came yet. */
void tact_strength_reset(tact_strength_state *state);

/* One sample, threshold units. */
float tact_strength_step(const tact_strength *table, tact_strength_state *state, float reference);

/* Returns 1 if every figure of a table is a number, and what it runs is stable. */
int tact_strength_is_valid(const tact_strength *table);

#endif
