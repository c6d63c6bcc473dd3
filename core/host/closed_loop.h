/* Controller and simulated display together, in blocks: channels times samples in one call.
 *
 *     r --> controller --> [ delay_samples ] --> D/A --> display --> A/D --+
 *               ^                                                         |
 *               +---------------------------------------------------------+
 *
 * Row k of the trace is the instant k: the A/D reads position_v, and the D/A begins to put out command_v, which was
 * computed delay_samples earlier. Every pointer of a trace may be NULL. Arrays are (samples, channels), row by row.
 *
 * Example use:
 *   tact_trace trace = {command_v, position_v, displacement_mm, saturated, broken};
 *   tact_closed_loop_play(loops, 3, reference, NULL, &trace, samples);
 */
#ifndef TACT_CLOSED_LOOP_H
#define TACT_CLOSED_LOOP_H

#include <stddef.h>
#include <stdint.h>

#include "control/controller.h"
#include "display/display.h"
#include "strength/strength.h"

enum { TACT_DELAY_MAX = 8 };
enum { TACT_SATURATED_POSITION = 1, TACT_SATURATED_COMMAND = 2, TACT_BROKEN = 4 };

typedef struct {
    const tact_controller *controller; /* NULL: none is loaded, the channel can only be driven */
    const tact_display *display;
    const tact_strength *strength; /* of the controller; its is_on 0: a reference stays as it comes */
    tact_controller_state controller_state;
    tact_strength_state strength_state;
    tact_display_state display_state;
    int32_t delay_samples; /* 0 to TACT_DELAY_MAX */
    int32_t delay_at;
    int32_t delayed_code[TACT_DELAY_MAX];
    int32_t delayed_flags[TACT_DELAY_MAX];
} tact_closed_loop;

typedef struct {
    double *command_v;       /* at the motor */
    double *position_v;      /* as the processor reads it */
    double *displacement_mm; /* what a finger feels */
    uint8_t *saturated;      /* 1: a converter or the command's limit was reached */
    uint8_t *broken;         /* 1: the controller's arithmetic had overflowed */
} tact_trace;

/* Controller states and the computing delay to zero command; the device stays as it is. */
void tact_closed_loop_rest(tact_closed_loop *loop);

/* samples through the loops: reference in threshold units, which the controller gets in single precision; force_v (may
 * be NULL) in volts of command. */
void tact_closed_loop_play(tact_closed_loop *loops, int channels, const double *reference, const double *force_v,
                           const tact_trace *trace, size_t samples);

/* samples straight to the D/A, without controller and computing delay. */
void tact_closed_loop_drive(tact_closed_loop *loops, int channels, const double *command_v, const double *force_v,
                            const tact_trace *trace, size_t samples);

#endif
