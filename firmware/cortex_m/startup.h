/* From reset to main() on a Cortex-M, and what becomes of a fault.
 *
 * Example use, in a board's vectors:
 *   [0] = (tact_vector)&tact_stack_top, [1] = tact_reset, [3] = tact_halt, [15] = tact_systick
 */
#ifndef TACT_STARTUP_H
#define TACT_STARTUP_H

#include <stdint.h>

typedef void (*tact_vector)(void);

extern uint32_t tact_stack_top; /* of the linker script */

/* Stack, vectors and interrupts as out of reset, whatever a bootloader left; memory as C wants it, main(). */
void tact_reset(void);

/* Outputs safe, on a stack of its own making; then it waits for the watchdog. For every fault and every interrupt that
 * should not come. */
void tact_halt(void);

#endif
