/* Cycles of the processor that the board's step takes in the timer's interrupt, by the counter of its debug unit (DWT).
 *
 * What interrupts the step is counted with it: bytes of the link. Nothing here depends on a count.
 *
 * Example use:
 *   tact_cycles_start();                          once
 *   tact_cycles_from();                           in the interrupt, before the step
 *   tact_cycles_to();                             and after it
 *   link->bench = tact_cycles_count;
 */
#ifndef TACT_CYCLES_H
#define TACT_CYCLES_H

#include <stdint.h>

/* The counter runs. */
void tact_cycles_start(void);

void tact_cycles_from(void);
void tact_cycles_to(void);

/* Least, most and sum of the last count, once it is whole: three zeros until then. Another number of periods than the last
 * time begins a count of so many; the same may be asked again and again. At most a million, so that the sum has room. */
void tact_cycles_count(uint32_t periods, uint32_t *counts);

#endif
