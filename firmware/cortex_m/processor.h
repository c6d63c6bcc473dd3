/* The processor as it comes out of reset, whether it does or a bootloader has jumped here.
 *
 * Example use, with interrupts masked:
 *   tact_processor_begin((uint32_t)&tact_vectors);
 */
#ifndef TACT_PROCESSOR_H
#define TACT_PROCESSOR_H

#include <stdint.h>

/* The vector table at this address, the timer stopped, every interrupt off and none pending, the floating-point unit on. */
void tact_processor_begin(uint32_t vectors);

#endif
