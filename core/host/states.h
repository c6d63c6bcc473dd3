/* States of a sampled linear system driven by one input: the inner loop of a continuous model's simulation.
 *
 *   x[k+1] = x[k] + D x[k] + b0 u[k] + b1 u[k+1]        out[k] = x[k]
 *
 * D = exp(A T) - I is given rather than exp(A T): with poles far below the sampling rate the difference keeps the
 * digits that the sum would lose. b1 = 0 is a zero-order hold; both together are a first-order hold (u[count] is
 * taken as u[count-1]). x is the caller's and carries on from block to block. At most TACT_STATES_MAX states.
 */
#ifndef TACT_STATES_H
#define TACT_STATES_H

#include <stddef.h>

enum { TACT_STATES_MAX = 24 };

/* d: n x n, row by row; out: count rows of n. Returns 0, or -1 when n is out of range. */
int tact_states_run(size_t n, const double *d, const double *b0, const double *b1, size_t count, const double *u,
                    double *x, double *out);

/* Low-passes of first order of one input, from rest: y[k] = decay y[k-1] + (1 - decay) u[k] for each decay. out: decays
 * rows of count. */
void tact_low_passes_run(size_t decays, const double *decay, size_t count, const double *u, double *out);

#endif
