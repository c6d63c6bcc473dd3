/* Dahl friction's state along a recorded position, -1 .. 1: the Coulomb level times it is the friction.
 *
 *   dz = dx / presliding * (1 - z sign(dx))
 *
 * Each step is solved exactly for dx of one sign (z runs towards sign(dx) exponentially; the exponential is taken as
 * its (1,1) Pade quotient, held within 0 .. 1), so that coarse steps stay bounded.
 * Source: P. Dahl, A Solid Friction Model, 1968.
 */
#ifndef TACT_DAHL_H
#define TACT_DAHL_H

#include <stddef.h>

/* position: count values; presliding: in the same unit, positive; z: the caller's, carries on; out: count values,
 * the state after the step to position[k]. previous: last position of the block before. */
void tact_dahl_run(size_t count, const double *position, double presliding, double *previous, double *z, double *out);

#endif
