/* A block of reference taken over from whoever made it: copied, and looked at on the way.
 *
 *     from  | x0 x1 x2 ... |  ---> to | x0 x1 x2 ... |       one pass through memory
 *                            \--> is any |x| > most, infinite, or not a number?
 *
 * Example use:
 *   if (!tact_reference_take(asked, own, samples * channels, 1000.0))
 *       refuse();
 */
#ifndef TACT_REFERENCE_H
#define TACT_REFERENCE_H

#include <stddef.h>

/* Copies count numbers. 1: each is finite and within +/- most; most is finite and not negative. */
int tact_reference_take(const double *from, double *to, size_t count, double most);

#endif
