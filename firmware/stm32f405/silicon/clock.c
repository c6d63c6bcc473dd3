/* 168 MHz from a crystal of TACT_CRYSTAL_MHZ: 12 on the Feather, 8 on the Olimex H405; cycles by the debug unit (DWT). */

#include "stm32f405/chip.h"
#include "stm32f405/registers.h"

#ifndef TACT_CRYSTAL_MHZ
#define TACT_CRYSTAL_MHZ 12
#endif

enum { LOOKS = 1000000, TRACE_ON = 1 << 24, CYCLES_ON = 1 };
enum { CRYSTAL_ON = 1 << 16, CRYSTAL_READY = 1 << 17, PLL_ON = 1 << 24, PLL_READY = 1 << 25 };
enum { TIMES_336 = 336 << 6, USB_BY_7 = 7 << 24, FROM_CRYSTAL = 1 << 22 }; /* 1 MHz * 336 / 2 */
enum { APB1_BY_4 = 5 << 10, APB2_BY_2 = 4 << 13, SWITCH_TO_PLL = 2, SWITCHED = 3 << 2, SWITCHED_TO_PLL = 2 << 2 };
enum { FLASH_WAITS_5 = 5, FLASH_CACHES = 7 << 8 };

static int await(uint32_t address, uint32_t mask, uint32_t wanted)
{
    for (uint32_t looks = 0; looks < LOOKS; looks++)
        if ((tact_get(address) & mask) == wanted)
            return 1;
    return 0;
}

int tact_chip_clock(void)
{
    tact_set(DEBUG_TRACE, tact_get(DEBUG_TRACE) | TRACE_ON);
    tact_set(DWT + DWT_CYCLES, 0);
    tact_set(DWT + DWT_CONTROL, tact_get(DWT + DWT_CONTROL) | CYCLES_ON);
    tact_set(RCC + RCC_CONTROL, tact_get(RCC + RCC_CONTROL) | CRYSTAL_ON);
    if (!await(RCC + RCC_CONTROL, CRYSTAL_READY, CRYSTAL_READY))
        return 0;
    tact_set(RCC + RCC_PLL, TACT_CRYSTAL_MHZ | TIMES_336 | FROM_CRYSTAL | USB_BY_7);
    tact_set(RCC + RCC_CONTROL, tact_get(RCC + RCC_CONTROL) | PLL_ON);
    if (!await(RCC + RCC_CONTROL, PLL_READY, PLL_READY))
        return 0;
    tact_set(FLASH, FLASH_WAITS_5 | FLASH_CACHES); /* before the clock is fast */
    tact_set(RCC + RCC_CONFIGURE, APB1_BY_4 | APB2_BY_2);
    tact_set(RCC + RCC_CONFIGURE, APB1_BY_4 | APB2_BY_2 | SWITCH_TO_PLL);
    return await(RCC + RCC_CONFIGURE, SWITCHED, SWITCHED_TO_PLL);
}

uint32_t tact_chip_cycles(void)
{
    return tact_get(DWT + DWT_CYCLES);
}
