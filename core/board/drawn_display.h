/* A display for checks: the guard's own model of each plant, moved by the codes that a board puts out, in float32.
 *
 *     D/A code --> volts --(+)--> [ x, w of the safety table, heavier or lighter ] --(+)--> A/D code --> [ lie ] --> code
 *                           ^ force                                                    ^ noise
 *
 * It is no simulation of a display (core/display/ is), but enough of one for the guard to find nothing amiss, on any
 * board, in as many instructions as a period takes. What happens to it is drawn from a generator: forces, loads, and a
 * sensor that lies.
 *
 * Example use:
 *   tact_drawn_event(&display, &board.safety, &noise);            now and then
 *   tact_drawn_codes(&display, &board.safety, out, in, &noise);   every tick
 */
#ifndef TACT_DRAWN_DISPLAY_H
#define TACT_DRAWN_DISPLAY_H

#include <stdint.h>

#include "arithmetic/noise.h"
#include "board/safety.h"

typedef enum {
    TACT_LIE_NONE = 0,
    TACT_LIE_OPEN,
    TACT_LIE_ZERO,
    TACT_LIE_FROZEN,
    TACT_LIE_REVERSED,
    TACT_LIE_STUCK,   /* within two codes of what it was */
    TACT_LIE_OFFSET,
    TACT_LIE_DRIFT,
    TACT_LIE_ANYTHING,
    TACT_LIE_LAST = TACT_LIE_ANYTHING
} tact_lie;

typedef struct {
    float x, w;             /* volts of y; a tick */
    float before_v;         /* at the motor, in the period before */
    float force_v, mobility; /* from outside; share of the plant's own drive and damping */
    int32_t lie, code, amount;
} tact_drawn_channel;

typedef struct {
    tact_drawn_channel channel[TACT_CHANNELS_MAX];
} tact_drawn_display;

/* At rest, free, with a sound sensor. */
void tact_drawn_rest(tact_drawn_display *display);

/* A channel is touched, pressed or let go, or its sensor begins to lie or is mended. */
void tact_drawn_event(tact_drawn_display *display, const tact_safety *safety, tact_noise *noise);

/* The A/D's codes at this instant, the D/A having put `out` out. */
void tact_drawn_codes(tact_drawn_display *display, const tact_safety *safety, const int32_t *out, int32_t *in,
                      tact_noise *noise);

#endif
