/* The converters' bus: SPI2 and a handful of pins.
 *
 *     SCK PB13  MISO PB14  MOSI PB15        10.5 MHz, idle high, data taken at the falling edge: both converters' way
 *     A/D: CONVST PC6, BUSY PC7, CS PB8, RESET PB9        D/A: SYNC PC3, LDAC PC2, CLR PA5        amplifier: PA4
 *
 * Every wait has an end: a converter that is not there makes a function return 0, never the interrupt stand still.
 *
 * Example use:
 *   tact_bus_select(TACT_PIN_AD_CS);
 *   good = tact_bus_exchange(bytes, 2);
 *   tact_bus_deselect(TACT_PIN_AD_CS);
 */
#ifndef TACT_STM32F405_BUS_H
#define TACT_STM32F405_BUS_H

#include <stdint.h>

/* port << 4 | number */
typedef enum {
    TACT_PIN_AMPLIFIER = 0x04,
    TACT_PIN_DA_CLR = 0x05,
    TACT_PIN_AD_CS = 0x18,
    TACT_PIN_AD_RESET = 0x19,
    TACT_PIN_DA_LDAC = 0x22,
    TACT_PIN_DA_SYNC = 0x23,
    TACT_PIN_AD_START = 0x26,
    TACT_PIN_AD_BUSY = 0x27
} tact_pin;

/* All peripherals as out of reset, then pins and SPI: chips not selected, outputs safe. */
void tact_bus_begin(void);

void tact_bus_raise(tact_pin pin);
void tact_bus_lower(tact_pin pin);

/* A chip's select is low while it is spoken to. */
void tact_bus_select(tact_pin pin);
void tact_bus_deselect(tact_pin pin);

/* Looks at a pin until it is at `level`, so many times at most: 1 if it came. */
int tact_bus_await(tact_pin pin, uint32_t level, uint32_t looks);

/* size bytes there, and what comes back in their place: 1, or 0 if the bus is stuck. */
int tact_bus_exchange(uint8_t *bytes, uint32_t size);

/* At least so long. */
void tact_bus_wait_us(uint32_t duration_us);

/* The amplifier off and the D/A at 0 V by two of its pins: one store, from anywhere, whatever memory holds. */
void tact_bus_outputs_safe(void);

/* The D/A follows its codes, and the amplifier the D/A. */
void tact_bus_outputs_on(void);

#endif
