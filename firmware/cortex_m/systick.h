/* The timer of a Cortex-M, and what is shared by all boards that have one.
 *
 * Example use:
 *   tact_systick_start(168000000u / 4000u, tick);
 */
#ifndef TACT_SYSTICK_H
#define TACT_SYSTICK_H

#include <stdint.h>

/* `tick` every so many clocks, at the priority of the timer's interrupt. */
void tact_systick_start(uint32_t clocks, void (*tick)(void));

/* Since the interrupt was due, 1/256 of a period; 256 more if one was missed. */
uint32_t tact_systick_lateness(void);

/* The vector. */
void tact_systick(void);

#endif
