/* AD7606: eight 16-bit A/D converters that sample at the same instant, range +/- 10 V (its pin RANGE high), behind SPI.
 *
 *     CONVST  ____/~~~~~~~~~~~~~~\________     samples at the edge
 *     BUSY    _____/~~~~~~~~~\____________     4 us
 *     CS      ~~~~~~~~~~~~~~~~~~~\______/~     16 bits a channel on DOUTA, channel 1 first, two's complement
 *
 * Oversampling is off (OS0 ... OS2 low), the serial interface chosen (PAR/SER high).
 *
 * Example use:
 *   tact_ad7606_begin();
 *   if (!tact_ad7606_read(codes, 3)) the converter does not answer;
 */
#ifndef TACT_AD7606_H
#define TACT_AD7606_H

#include <stdint.h>

enum { TACT_AD7606_CHANNELS = 8 };

/* A pulse on its RESET. */
void tact_ad7606_begin(void);

/* Readings of this instant, of the first so many channels: 1 if a conversion began and ended; 0 if not, and the codes
 * are left alone. */
int tact_ad7606_read(int32_t *codes, int32_t channels);

#endif
