/* Channels on one frame: the force of each motor also acts, through the frame, on all the other channels.
 *
 *     motor volts of j --> path (order 2, held) --> x share --> force on every i but j, volts of command
 *
 * The path answers a sample later than the force at the earliest, so that all channels step in any order. Without a
 * frame the loops are played by themselves (display/closed_loop.h), and nothing here is run.
 *
 * Example use:
 *   tact_coupled_play(&frame, loops, 3, reference, NULL, &trace, samples);
 */
#ifndef TACT_COUPLING_H
#define TACT_COUPLING_H

#include <stddef.h>

#include "display/closed_loop.h"

enum { TACT_COUPLING_CHANNELS_MAX = 64, TACT_COUPLING_ORDER = 2 };

typedef struct {
    tact_plant path; /* of order 2, its `sensor` row the force that arrives; 1 at rest */
    double share;
    double x[TACT_COUPLING_CHANNELS_MAX][TACT_COUPLING_ORDER];
} tact_coupling;

/* As tact_closed_loop_play and tact_closed_loop_drive, for up to TACT_COUPLING_CHANNELS_MAX channels on the frame. */
void tact_coupled_play(tact_coupling *frame, tact_closed_loop *loops, int channels, const double *reference,
                     const double *force_v, const tact_trace *trace, size_t samples);
void tact_coupled_drive(tact_coupling *frame, tact_closed_loop *loops, int channels, const double *command_v,
                      const double *force_v, const tact_trace *trace, size_t samples);

#endif
