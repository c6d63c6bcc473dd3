/* Figures of one channel's feed-forward for a finger, and the states it goes through.
 *
 * learning.h says how the weights are found, feed_forward.h what is done with them.
 */
#ifndef TACT_TOUCH_TABLE_H
#define TACT_TOUCH_TABLE_H

#include <stdint.h>

#include "arithmetic/section.h"

enum { TACT_TOUCH_FEEDBACK_MAX = 4, TACT_TOUCH_DELAY_MAX = 16, TACT_TOUCH_HUM_MAX = 4 };
enum { TACT_TOUCH_LEVEL_RATE = 3 }; /* the pushes' level is taken over a third of the shortest memory */

typedef struct {
    int32_t delay;       /* samples from command to reading, 1 to TACT_TOUCH_DELAY_MAX; 0: nothing is fed forward */
    int32_t turns, turn; /* learns in every turns-th sample, first after all but `turn` of them */
    int32_t hum_count;
    float plant[4];    /* b1 b2 a1 a2 of a section with b0 = 0: the position, one sample after the command */
    float corner;      /* of the three poles: 2 pi f T */
    float command[2];  /* of a command, into the balance's second and first pole */
    float position[3]; /* of a position, into its third, second and first pole */
    float mass[3];     /* what is fed of the first push, for a volt of command, of change, of place */
    float rest[2];     /* all of the second, for a volt of change, of place */
    float first[3], second[3]; /* both pushes as the model's poles hold them: their second and first change, the last */
    float slow;                /* of the slow parts, for a turn, as all below */
    float forgetting;          /* of the memory */
    float gate, ridge, shape, fading, slew, weight_max, push_max_v, hum_gain;
    float hum[TACT_TOUCH_HUM_MAX][2]; /* cosine and sine of the angle of a turn */
} tact_touch;

typedef struct {
    float balance[3], model[3]; /* what three poles hold of the finger's force, and of the unloaded loop's position */
    tact_section_state plant;
    tact_section_state feedback[TACT_TOUCH_FEEDBACK_MAX];
    float by_command, by_change, by_place; /* what the weights make of `mass` and `rest` */
    int32_t at;                            /* in the two rings */
    int32_t left;                          /* samples until the next turn of learning */
    float weight[2];
    float slow[3];      /* of force and pushes */
    float power, level; /* of the pushes: over the memory, and of late */
    float square[3], product[2];
    float hum[TACT_TOUCH_HUM_MAX][2]; /* each line at the last turn, and a quarter of its period before */
    float hum_learnt;                 /* by the last turn, of every line */
    float model_v[TACT_TOUCH_DELAY_MAX], command_v[TACT_TOUCH_DELAY_MAX];
} tact_touch_state;

/* At rest, nothing learnt. */
void tact_touch_reset(const tact_touch *table, tact_touch_state *state);

/* The model at rest and nothing passed of it; what was learnt stays. */
void tact_touch_rest_model(tact_touch_state *state);

/* Returns 1 if a table can be run, 0 if not. */
int tact_touch_is_valid(const tact_touch *table);

#endif
