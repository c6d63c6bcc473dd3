/* Port: all that differs between boards. One folder implements it for each board; see docs/porting.md.
 *
 *     timer ----> tick in main.c ----> put_out, read_in                  (in the interrupt)
 *            `--> supervisor ---> outputs on or safe, watchdog           (in the interrupt)
 *     link  <---> receive, send                                          (in the main loop)
 *     fault ----> outputs_safe                                           (from anywhere)
 */
#ifndef TACT_PORT_H
#define TACT_PORT_H

#include <stddef.h>
#include <stdint.h>

#include "board/board.h"
#include "link/link.h"

/* Outputs safe, clocks, link, converters; called once, before anything else. Gives the link `missing`, where something of
 * the board may be. */
void tact_port_begin(tact_board *board, tact_link *link);

/* The timer's interrupt at this rate from now on; it calls `tick`. */
void tact_port_start_timer(float rate_hz, void (*tick)(void));

/* Codes to the D/A, now. */
void tact_port_put_out(const int32_t *codes);

/* Readings of the A/D, of this instant. */
void tact_port_read_in(int32_t *codes);

/* How long after its time this interrupt began, 1/256 of a period; 256 and more if one was missed. */
uint32_t tact_port_lateness(void);

/* Cycles of the processor, round and round in 32 bits; always 0 where nothing counts them. */
uint32_t tact_port_cycles(void);

/* Bytes that have come, at most `most`; sleeps until the next interrupt if there are none. */
size_t tact_port_receive(uint8_t *bytes, size_t most);

/* Bytes to the host; returns when they are under way. */
void tact_port_send(const uint8_t *bytes, size_t size);

/* The timer's interrupt kept out: gives what was before, for tact_port_leave() to restore. */
uint32_t tact_port_enter(void);
void tact_port_leave(uint32_t before);

/* Amplifier off and D/A at zero, at once: from any interrupt or fault, whatever memory holds; needs no clock, no bus. */
void tact_port_outputs_safe(void);

/* The amplifier follows the D/A, which is at zero. The watchdog runs before. */
void tact_port_outputs_on(void);

/* The watchdog waits anew. Unfed for 20 ms at most it resets the processor; outputs are safe out of reset. */
void tact_port_feed_watchdog(void);

/* Whether the converters have done what was requested. */
int tact_port_is_sound(void);

#endif
