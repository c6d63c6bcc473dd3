/* One channel's controller: two degrees of freedom, anti-windup, limits, in float32.
 *
 *                +---+  v   e  +---+  u'  +-------+  u
 *     r -------->| F |--->(+)->| C |----->| clamp |----> to the D/A, delay_samples later
 *   threshold    +-^-+     ^-  +-^-+      +---+---+
 *   units          |       |     |            |
 *                  |       y     |            |
 *                  +-------------+-----<------+  u - u', where the command is cut
 *
 * Without feedback sections F's output is the command itself. Where a finger is fed forward (touch/feed_forward.h), that
 * is added to C's output. The controller is data: an image fills the table.
 *
 * Anti-windup in two steps. First F and C are conditioned (Hanus, Kinnaert & Henrotte 1987): all their states become
 * what a reference would have left of which the cut command is the answer, so that the loop stays linear and what is
 * felt is that reference; it is kept within reference_max (or r). What is still missing then, a force's part, goes by
 * back-calculation into the section that integrates, C's last (Astrom & Hagglund 2006, section 3.5).
 * A controller whose arithmetic breaks (a NaN or more than TACT_COMMAND_MAX before the clamp, as an unstable one
 * ends) latches `broken` and gives zero until it is reset.
 *
 * Example use:
 *   tact_controller_state state;
 *   tact_controller_reset(&state);
 *   float command_v = tact_controller_step(&table, &state, reference, position_v);
 *   tact_controller_put(&table, &state, command_v as it was put out);
 */
#ifndef TACT_CONTROLLER_H
#define TACT_CONTROLLER_H

#include <stdint.h>

#include "arithmetic/section.h"
#include "touch/feed_forward.h"

enum { TACT_PREFILTER_MAX = 8, TACT_FEEDBACK_MAX = TACT_TOUCH_FEEDBACK_MAX };

#define TACT_REFERENCE_MAX 1e6f /* threshold units: 120 dB SL */
#define TACT_COMMAND_MAX 1e20f  /* volts before the clamp */

typedef struct {
    int32_t prefilter_count;
    int32_t feedback_count; /* 0: no feedback */
    tact_section prefilter[TACT_PREFILTER_MAX];
    tact_section feedback[TACT_FEEDBACK_MAX];
    float conditioning;  /* threshold units for a volt: 1 / (product of all b0); 0: none */
    float reference_max; /* threshold units */
    float anti_windup[2];
    float command_max_v;
    tact_touch touch; /* its delay 0: no finger is fed forward */
} tact_controller;

typedef struct {
    tact_section_state prefilter[TACT_PREFILTER_MAX];
    tact_section_state feedback[TACT_FEEDBACK_MAX];
    int32_t clamped; /* the last command was cut to the limits */
    int32_t broken;  /* latched: see above */
    tact_touch_state touch;
} tact_controller_state;

/* All states zero. */
void tact_controller_reset(const tact_controller *table, tact_controller_state *state);

/* Cuts a command that is beyond the limits, with anti-windup; zero from where the arithmetic broke. */
float tact_controller_limit(const tact_controller *table, tact_controller_state *state, float reference, float wanted);

/* One sample: reference (threshold units, within TACT_REFERENCE_MAX) and position (volts, finite: a converter gave it)
 * in, command (volts, within the limits) out. */
static inline float tact_controller_step(const tact_controller *table, tact_controller_state *state, float reference,
                                         float position_v)
{
    const float asked = tact_sections_step(table->prefilter, state->prefilter, table->prefilter_count, reference);
    float wanted = asked;
    if (table->feedback_count)
        wanted = tact_sections_step(table->feedback, state->feedback, table->feedback_count, asked - position_v);
    if (table->touch.delay)
        wanted += tact_touch_step(&table->touch, &state->touch, table->feedback, table->feedback_count, asked, position_v);
    state->clamped = !(__builtin_fabsf(wanted) <= table->command_max_v);
    if (state->clamped | state->broken)
        return tact_controller_limit(table, state, reference, wanted);
    return wanted;
}

/* The command that was put out in answer to this sample. */
static inline void tact_controller_put(const tact_controller *table, tact_controller_state *state, float command_v)
{
    if (table->touch.delay)
        tact_touch_put(&table->touch, &state->touch, command_v);
}

#endif
