/* STM32F405: the processor's own exceptions and 82 interrupts, two of them in use. */

#include "cortex_m/startup.h"
#include "cortex_m/systick.h"
#include "stm32f405/usart.h"

enum { EXCEPTIONS = 16, INTERRUPTS = 82, USART3_CAME = EXCEPTIONS + 39, LAST = EXCEPTIONS + INTERRUPTS - 1 };

/* A falling supply (interrupt 1) halts the board as a fault does: watchdog.h. */
__attribute__((section(".vectors"), used)) static const tact_vector VECTORS[EXCEPTIONS + INTERRUPTS] = {
    [0] = (tact_vector)&tact_stack_top,
    [1] = tact_reset,
    [2 ... 14] = tact_halt,
    [15] = tact_systick,
    [EXCEPTIONS ... USART3_CAME - 1] = tact_halt,
    [USART3_CAME] = tact_usart,
    [USART3_CAME + 1 ... LAST] = tact_halt,
};
