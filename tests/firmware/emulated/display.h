/* The simulated display in the place of an emulated board's converters.
 *
 * The timer stands still while the display is computed, which no real board does: what that takes is no time of the
 * board's. Between runs the display's time stands still as well, so that what a board plays does not depend on how long
 * the host takes; in a free run time goes on, as on a real board.
 *
 * Example use, in a port:
 *   void tact_port_put_out(const int32_t *codes) { tact_emulated_put_out(codes); }
 */
#ifndef TACT_EMULATED_DISPLAY_H
#define TACT_EMULATED_DISPLAY_H

#include <stdint.h>

#include "board/board.h"
#include "link/link.h"

/* Registers the display with the link; the board may wait from now on. */
void tact_emulated_begin(tact_board *board, tact_link *link);

/* The timer is to call tact_emulated_come: `tick`, after which the display goes on; while time stands still, the watchdog
 * is fed and nothing else. by_leaps: it comes only where it is let. */
void tact_emulated_ticks(void (*tick)(void), int by_leaps);
void tact_emulated_come(void);

/* By leaps: all ticks that pass before the host is heard, one with each call; 0 once they have passed. */
int tact_emulated_leap(void);

/* As in port.h. Cycles: of the timer, within a tick. */
void tact_emulated_put_out(const int32_t *codes);
void tact_emulated_read_in(int32_t *codes);
uint32_t tact_emulated_cycles(void);

/* Whether time is to stand still: a board that rests or waits for its stream. */
int tact_emulated_holds(void);

/* The timer stands still, and goes on, once it has been started; whether it goes. Not by leaps. */
void tact_emulated_stand(void);
void tact_emulated_go_on(void);
int tact_emulated_goes(void);

/* A run whose time goes on, whatever the host does. */
int tact_emulated_runs_freely(void);

enum { TACT_KEEPS_UP = 0, TACT_IS_SILENT, TACT_FEEDS_LITTLE };

/* And its host has been silent for a while, or has fed little ahead and has been silent for 1/part of that: the board
 * should leave it the machine. Where the emulator's time follows the instructions, a sleep until the next interrupt (WFI)
 * leaps there at once. */
int tact_emulated_is_behind(uint32_t part);

#endif
