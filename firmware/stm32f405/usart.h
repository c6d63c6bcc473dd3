/* The link: USART3 at TACT_BAUD, PB10 sends, PB11 receives. Bytes are taken by an interrupt more urgent than the timer's,
 * into a ring of 8 KiB, so that none is lost while an answer is made.
 *
 * Example use:
 *   size = tact_usart_receive(bytes, sizeof bytes);
 */
#ifndef TACT_STM32F405_USART_H
#define TACT_STM32F405_USART_H

#include <stddef.h>
#include <stdint.h>

/* After tact_bus_begin() and with the clock up. */
void tact_usart_begin(void);

/* What has come, at most so many bytes. */
size_t tact_usart_receive(uint8_t *bytes, size_t most);

/* Whether there is anything. */
int tact_usart_has(void);

void tact_usart_send(const uint8_t *bytes, size_t size);

/* The vector. */
void tact_usart(void);

#endif
