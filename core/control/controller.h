/* One channel's controller: two degrees of freedom, anti-windup, limits, in float32.
 *
 *                +---+  v   e  +---+  u'  +-------+  u
 *     r -------->| F |--->(+)->| C |----->| clamp |----> to the D/A, delay_samples later
 *   threshold    +-^-+     ^-  +-^-+      +---+---+
 *   units          |       |     |            |
 *                  |       y     |            |
 *                  +-------------+-----<------+  u - u', where the command is cut
 *
 * Without feedback sections F's output is the command itself. The controller is data: an image fills the table.
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
 */
#ifndef TACT_CONTROLLER_H
#define TACT_CONTROLLER_H

#include <stddef.h>
#include <stdint.h>

#include "arithmetic/section.h"

enum { TACT_PREFILTER_MAX = 8, TACT_FEEDBACK_MAX = 4 };

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
    float command_min_v;
    float command_max_v;
} tact_controller;

typedef struct {
    tact_section_state prefilter[TACT_PREFILTER_MAX];
    tact_section_state feedback[TACT_FEEDBACK_MAX];
    int32_t clamped; /* the last command was cut to the limits */
    int32_t broken;  /* latched: see above */
} tact_controller_state;

/* All states zero. */
void tact_controller_reset(tact_controller_state *state);

/* Returns 1 if the counts and limits of a table can be run, 0 if not. */
int tact_controller_is_valid(const tact_controller *table);

/* The limits alone; a NaN stays one. */
static inline float tact_controller_clamp(float wanted, float lowest, float highest)
{
    const float cut = wanted > highest ? highest : wanted;
    return cut < lowest ? lowest : cut;
}

/* Returns 1 if `wanted` is finite and below the size at which the controller latches broken, 0 if not. */
static inline int tact_controller_is_sound(float wanted)
{
    return (wanted < TACT_COMMAND_MAX) & (wanted > -TACT_COMMAND_MAX);
}

/* The change of reference that would have asked for `excess` volts more, as far as it may go. */
static inline float tact_controller_change(float conditioning, float reference_max, float reference, float excess)
{
    const float size = reference < 0.0f ? -reference : reference;
    const float most = size > reference_max ? size : reference_max;
    return tact_controller_clamp(reference + conditioning * excess, -most, most) - reference;
}

/* Anti-windup, where the sections' answer to `reference` was cut by `excess` volts (command less answer). */
void tact_controller_unwind(const tact_controller *table, tact_controller_state *state, float reference, float excess);

/* Applies the limits and the anti-windup to the sections' answer to `reference`. */
static inline float tact_controller_limit(const tact_controller *table, tact_controller_state *state, float reference,
                                   float wanted)
{
    const float command = tact_controller_clamp(wanted, table->command_min_v, table->command_max_v);
    if (command != wanted && table->feedback_count)
        tact_controller_unwind(table, state, reference, command - wanted);
    state->broken |= !tact_controller_is_sound(wanted);
    state->clamped = command != wanted;
    return state->broken ? 0.0f : command;
}

/* F's and C's answer to a sound reference, before its limits. */
static inline float tact_controller_sections(const tact_controller *table, tact_controller_state *state, float reference,
                                      float position_v)
{
    const float value = tact_sections_step(table->prefilter, state->prefilter, table->prefilter_count, reference);
    if (table->feedback_count == 0)
        return value;
    return tact_sections_step(table->feedback, state->feedback, table->feedback_count, value - position_v);
}

/* One sample: reference (threshold units, any bits) and position (volts, finite: a converter gave it) in, command
 * (volts, within the limits) out. */
static inline float tact_controller_step(const tact_controller *table, tact_controller_state *state, float reference,
                                  float position_v)
{
    const float asked = tact_finite(reference, TACT_REFERENCE_MAX);
    return tact_controller_limit(table, state, asked, tact_controller_sections(table, state, asked, position_v));
}

#endif
