#include "stm32f405/usart.h"

#include "stm32f405/registers.h"

enum { RING = 8192, USART3_CAME = 39, APB1_USART3 = 1 << 18, FUNCTION_USART3 = 7, ALTERNATE = 2 };
enum { ON = 1 << 13, SENDS = 1 << 3, RECEIVES = 1 << 2, TELLS_OF_BYTES = 1 << 5, CAME = 1 << 5, EMPTY = 1 << 7 };

enum { CLOCK_HZ = 42000000, DIVIDER = (CLOCK_HZ + TACT_BAUD / 2) / TACT_BAUD, RESULT = CLOCK_HZ / DIVIDER };
_Static_assert(DIVIDER >= 16 && RESULT - TACT_BAUD <= TACT_BAUD / 64 && TACT_BAUD - RESULT <= TACT_BAUD / 64,
               "a baud rate within 1.5 % of 42 MHz by a whole number from 16 on");

static uint8_t ring[RING];
static volatile uint32_t written, taken; /* bytes, each counted by one side alone */

static void set_up_pin(uint32_t at)
{
    const uint32_t shift = 4u * (at - 8u), function = GPIOB + GPIO_FUNCTION_HIGH, mode = GPIOB + GPIO_MODE;
    tact_set(function, (tact_get(function) & ~(15u << shift)) | (uint32_t)FUNCTION_USART3 << shift);
    tact_set(mode, (tact_get(mode) & ~(3u << (2u * at))) | (uint32_t)ALTERNATE << (2u * at));
}

void tact_usart_begin(void)
{
    tact_clock_on(RCC_APB1, APB1_USART3);
    tact_set(GPIOB + GPIO_PULL, tact_get(GPIOB + GPIO_PULL) | 1u << 22); /* an open line is silent */
    set_up_pin(10);
    set_up_pin(11);
    tact_set(USART3 + USART_RATE, DIVIDER);
    tact_set(USART3 + USART_CONTROL, ON | SENDS | RECEIVES | TELLS_OF_BYTES);
    tact_set(NVIC_ENABLE + 4u * (USART3_CAME / 32u), 1u << (USART3_CAME % 32u));
}

/* A byte that the ring has no room for is lost; the link notices. Reading the state and then the byte clears whatever
 * was wrong with it. */
void tact_usart(void)
{
    const uint32_t state = tact_get(USART3 + USART_STATE);
    const uint8_t byte = (uint8_t)tact_get(USART3 + USART_DATA);
    if (state & CAME && written - taken < RING) {
        ring[written % RING] = byte;
        written = written + 1u;
    }
}

int tact_usart_has(void)
{
    return taken != written;
}

size_t tact_usart_receive(uint8_t *bytes, size_t most)
{
    size_t size = 0;
    while (size < most && tact_usart_has()) {
        bytes[size++] = ring[taken % RING];
        taken = taken + 1u;
    }
    return size;
}

void tact_usart_send(const uint8_t *bytes, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        while (!(tact_get(USART3 + USART_STATE) & EMPTY)) {
        }
        tact_set(USART3 + USART_DATA, bytes[i]);
    }
}
