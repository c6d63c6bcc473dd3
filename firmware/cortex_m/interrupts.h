/* Interrupts of a Cortex-M: kept out for a while, and waited for.
 *
 * Example use:
 *   uint32_t before = tact_interrupts_enter();
 *   ...
 *   tact_interrupts_leave(before);
 */
#ifndef TACT_INTERRUPTS_H
#define TACT_INTERRUPTS_H

#include <stdint.h>

enum { TACT_TIMER_PRIORITY = 0x80 }; /* what receives bytes is more urgent: a byte waits for 5 us only */

/* The timer's interrupt kept out, with all of lower urgency; gives what was before, to be restored. */
uint32_t tact_interrupts_enter(void);
void tact_interrupts_leave(uint32_t before);

/* Until the next interrupt; with a reason not to, only if there is none at the last moment. */
void tact_sleep(void);
void tact_sleep_unless(int (*reason)(void));

#endif
