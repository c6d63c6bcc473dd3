/* Figures of one channel's feed-forward for a finger, and the states it goes through. float32, in both formats.
 *
 * learning.h says how the weights are found, feed_forward.h what is done with them.
 */
#ifndef TACT_TOUCH_TABLE_H
#define TACT_TOUCH_TABLE_H

#include <stdint.h>

#include "arithmetic/section.h"

enum { TACT_TOUCH_FEEDBACK_MAX = 4, TACT_TOUCH_DELAY_MAX = 16, TACT_TOUCH_HUM_MAX = 4 };
enum { TACT_TOUCH_LEVEL_RATE = 3 }; /* the pushes' level is taken over a third of the shortest memory */

#define TACT_TOUCH_SILENT 1e-12f /* volts: less is nothing */

typedef struct {
    int32_t feedback_count; /* 0: nothing is fed forward */
    int32_t delay;          /* samples from command to reading, 1 to TACT_TOUCH_DELAY_MAX */
    int32_t turns, turn;    /* learns in every turns-th sample, first after `turn` of them */
    int32_t hum_count;
    tact_section feedback[TACT_TOUCH_FEEDBACK_MAX];
    float plant[4]; /* b1 b2 a1 a2 of a section with b0 = 0: the position, one sample after the command */
    float per_sample;            /* 1/T */
    float drag, spring;          /* the plant's own: volts for a speed, for a place */
    float mass, damping, stiffness; /* the finger's: a share of the acceleration; volts for a speed, for a place */
    float corner;                /* of the three poles: 2 pi f T */
    float force, inverse[3];     /* of what the poles hold: section.h's d in the plant's numerator, its denominator */
    float slow;                  /* of the slow parts, for a turn, as all below */
    float forgetting, gate, ridge, shape, fading, slew;
    float weight_max, push_max_v;
    float hum_gain;
    float hum[TACT_TOUCH_HUM_MAX][2]; /* cosine and sine of the angle of a turn */
} tact_touch;

typedef struct {
    float past[3]; /* what three poles hold */
} tact_touch_poles;

typedef struct {
    tact_section_state feedback[TACT_TOUCH_FEEDBACK_MAX];
    tact_section_state plant;
    tact_touch_poles command, position, push[2];
    float weight[2];
    float slow[3];             /* of force and pushes */
    float power, level;           /* of the pushes: over the memory, and of late */
    float square[3], product[2];
    float hum[TACT_TOUCH_HUM_MAX][4]; /* cosine, sine, and how much of either */
    int32_t at, count;
    float model_v[TACT_TOUCH_DELAY_MAX], command_v[TACT_TOUCH_DELAY_MAX];
    float pushed_v[2][TACT_TOUCH_DELAY_MAX];
} tact_touch_state;

/* At rest, nothing learnt. */
void tact_touch_reset(const tact_touch *table, tact_touch_state *state);

/* The model at rest and nothing passed of it; what was learnt stays. */
void tact_touch_rest_model(tact_touch_state *state);

/* Returns 1 if the counts of a table can be run, 0 if not. */
int tact_touch_is_valid(const tact_touch *table);

#endif
