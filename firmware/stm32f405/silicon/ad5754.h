/* AD5754R: four 16-bit D/A converters with outputs of +/- 10 V, behind SPI.
 *
 *     frame, 24 bits, most significant first:  R/W | 0 | register (3) | address (3) | data (16)
 *
 *     register 0: code of converter A ... D (addresses 0 ... 3)      1: range (4: +/- 10 V)
 *              2: power (bits 0 ... 3: converters, 4: reference; read: 5: too hot, 7 ... 10: too much current)
 *              3: control (address 0: nothing; 1: bit 1: what CLR brings, bit 2: current clamp, bit 3: thermal shutdown)
 *
 * Codes are two's complement (the pin BIN/2sCOMP at ground). Codes written take effect when LDAC goes low, all at once.
 * CLR low brings 0 V to all outputs, whatever was written. A reading comes with the frame after the one that asked.
 *
 * Example use:
 *   if (!tact_ad5754_begin()) there is none;
 *   int good = tact_ad5754_write(codes, 3);
 */
#ifndef TACT_AD5754_H
#define TACT_AD5754_H

#include <stdint.h>

enum { TACT_AD5754_CHANNELS = 4 };

/* +/- 10 V, all at zero, powered: 1 if it says so itself; 0 if not, and then nothing may be connected to it. */
int tact_ad5754_begin(void);

/* Codes out, all at the same instant: 1 if the bus took them. */
int tact_ad5754_write(const int32_t *codes, int32_t channels);

/* Whether range and power are still as they were set, and nothing is too hot or overloaded. */
int tact_ad5754_is_sound(void);

#endif
