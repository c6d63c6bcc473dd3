/* What an emulator's STM32F405 has not got: a clock that has to be waited for, and converters on a bus.
 *
 * silicon/ is the board itself; tests stand in for it with the simulated display. All else is the same program.
 */
#ifndef TACT_STM32F405_CHIP_H
#define TACT_STM32F405_CHIP_H

#include <stddef.h>
#include <stdint.h>

#include "link/link.h"

enum { TACT_NO_CLOCK = -1 };

/* 168 MHz, whatever was before, and cycles counted: 0 from the crystal, TACT_MISSING_CRYSTAL without it, or TACT_NO_CLOCK. */
int32_t tact_chip_clock(void);

/* Converters of so many channels tested: 0, or TACT_MISSING_AD | TACT_MISSING_DA. Without one of them neither is used, and a
 * reading is a sixteenth of the command: a bare run still exercises the arithmetic. */
int32_t tact_chip_converters(int32_t count);

/* As in port.h. */
void tact_chip_put_out(const int32_t *codes);
void tact_chip_read_in(int32_t *codes);
int tact_chip_is_sound(void);
uint32_t tact_chip_cycles(void);

/* As in port.h: bytes that have come; sleeps until the next interrupt if there are none. */
size_t tact_chip_receive(uint8_t *bytes, size_t most);

#endif
