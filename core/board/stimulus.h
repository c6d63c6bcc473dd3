/* Stimulus made on the board: tones with raised-cosine ramps, one after another or at once.
 *
 *     amplitude |    ____            ___        tone i: from `start` for `length` ticks after the run begins, its
 *               |   /    \          /   \       first and last `ramp` ticks raised cosines; two tones with a gap are
 *               |__/      \________/     \__    the intervals of a trial
 *
 * Sine and ramp come from rotations by a given cosine and sine (no libm), each held to length 1 by a Newton step.
 *
 * Example use:
 *   float reference = tact_stimulus_next(&stimulus, tick);
 */
#ifndef TACT_STIMULUS_H
#define TACT_STIMULUS_H

#include <stddef.h>
#include <stdint.h>

enum { TACT_TONES_MAX = 8 };

typedef struct {
    uint32_t start, length, ramp; /* ticks; 2 ramp <= length */
    float amplitude;              /* threshold units, peak */
    float cosine, sine;           /* of the angle per tick */
    float ramp_cosine, ramp_sine; /* of pi / ramp */
} tact_tone;

typedef struct {
    float cosine, sine;           /* of the tone's phase */
    float ramp_cosine, ramp_sine; /* of the ramp's */
} tact_tone_state;

typedef struct {
    int32_t count;
    tact_tone tone[TACT_TONES_MAX];
    tact_tone_state state[TACT_TONES_MAX];
} tact_stimulus;

/* 1 if a tone's numbers can be played. */
int tact_tone_is_valid(const tact_tone *tone);

/* Tones from their beginning again. */
void tact_stimulus_rewind(tact_stimulus *stimulus);

/* The sum of the tones at this tick of the run; to be called once for every tick, in order. */
float tact_stimulus_next(tact_stimulus *stimulus, uint32_t tick);

#endif
