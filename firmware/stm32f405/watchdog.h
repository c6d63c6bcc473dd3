/* The independent watchdog, and the watch over the supply.
 *
 * The watchdog runs from its own oscillator, of 17 to 47 kHz: it resets the processor 6.5 to 17.9 ms after it was
 * fed last. Out of reset no pin drives anything: resistors hold the amplifier off and the D/A's CLR low.
 *
 * Example use:
 *   tact_watchdog_start();
 *   tact_watchdog_feed();        at every tick
 */
#ifndef TACT_STM32F405_WATCHDOG_H
#define TACT_STM32F405_WATCHDOG_H

/* Its period in force and begun, some 0.3 ms later: 1; it cannot be stopped again. Not from the interrupt. */
int tact_watchdog_start(void);
void tact_watchdog_feed(void);

/* A supply below 2.9 V takes the fault's vector, long before the processor fails at 1.8 V. */
void tact_supply_watch(void);

/* Whether it is below 2.9 V now: one that was low before the watch began does not fall. */
int tact_supply_is_low(void);

#endif
