/* 168 MHz from a crystal of TACT_CRYSTAL_MHZ: 12 on the Feather, 8 on the Olimex H405; cycles by the debug unit (DWT).
 * Without the crystal, from the internal oscillator (1 %): enough to answer and to say so. */

#include "stm32f405/chip.h"
#include "stm32f405/registers.h"

#ifndef TACT_CRYSTAL_MHZ
#define TACT_CRYSTAL_MHZ 12
#endif

enum { LOOKS = 200000 }; /* some 75 ms at 16 MHz: a crystal starts within 5 */
enum { TRACE_ON = 1 << 24, CYCLES_ON = 1 };
enum { INTERNAL_ON = 1, INTERNAL_READY = 2, INTERNAL_MHZ = 16, CRYSTAL_ON = 1 << 16, CRYSTAL_READY = 1 << 17 };
enum { CRYSTAL_BYPASSED = 1 << 18, CRYSTAL_WATCHED = 1 << 19, PLL_ON = 1 << 24, PLL_READY = 1 << 25 };
enum { TIMES_336 = 336 << 6, USB_BY_7 = 7 << 24, FROM_CRYSTAL = 1 << 22 }; /* 1 MHz * 336 / 2 */
enum { APB1_BY_4 = 5 << 10, APB2_BY_2 = 4 << 13, FROM_INTERNAL = 0, SWITCH_TO_PLL = 2, SWITCHED = 3 << 2, SWITCHED_TO_PLL = 2 << 2 };
enum { FLASH_WAITS_5 = 5, FLASH_WAITS = 7, FLASH_CACHES = 7 << 8, FLASH_CACHES_EMPTY = 3 << 11 };
enum { APB1_PWR = 1 << 28, PWR_FOR_168_MHZ = 1 << 14 };

static int await(uint32_t address, uint32_t mask, uint32_t wanted)
{
    for (uint32_t looks = 0; looks < LOOKS; looks++)
        if ((tact_get(address) & mask) == wanted)
            return 1;
    return 0;
}

static void change(uint32_t address, uint32_t off, uint32_t on)
{
    tact_set(address, (tact_get(address) & ~off) | on);
}

/* The internal oscillator, nothing else running: a bootloader leaves the PLL on, whose factors cannot be written then. */
static int from_reset(void)
{
    change(RCC + RCC_CONTROL, 0, INTERNAL_ON);
    if (!await(RCC + RCC_CONTROL, INTERNAL_READY, INTERNAL_READY))
        return 0;
    tact_set(RCC + RCC_CONFIGURE, FROM_INTERNAL);
    if (!await(RCC + RCC_CONFIGURE, SWITCHED, FROM_INTERNAL))
        return 0;
    change(RCC + RCC_CONTROL, PLL_ON | CRYSTAL_ON | CRYSTAL_WATCHED, 0);
    change(RCC + RCC_CONTROL, CRYSTAL_BYPASSED, 0); /* not while it is on */
    return await(RCC + RCC_CONTROL, PLL_READY | CRYSTAL_READY, 0);
}

int32_t tact_chip_clock(void)
{
    change(DEBUG_TRACE, 0, TRACE_ON);
    tact_set(DWT + DWT_CYCLES, 0);
    change(DWT + DWT_CONTROL, 0, CYCLES_ON);
    if (!from_reset())
        return TACT_NO_CLOCK;
    change(RCC + RCC_CONTROL, 0, CRYSTAL_ON);
    const int crystal = await(RCC + RCC_CONTROL, CRYSTAL_READY, CRYSTAL_READY);
    tact_clock_on(RCC_APB1, APB1_PWR);
    change(PWR + PWR_CONTROL, 0, PWR_FOR_168_MHZ); /* while the PLL is off */
    tact_set(RCC + RCC_PLL, TIMES_336 | USB_BY_7 | (crystal ? TACT_CRYSTAL_MHZ | FROM_CRYSTAL : INTERNAL_MHZ));
    change(RCC + RCC_CONTROL, 0, PLL_ON);
    if (!await(RCC + RCC_CONTROL, PLL_READY, PLL_READY))
        return TACT_NO_CLOCK;
    tact_set(FLASH, FLASH_WAITS_5); /* before the clock is fast */
    tact_set(FLASH, FLASH_WAITS_5 | FLASH_CACHES_EMPTY);
    tact_set(FLASH, FLASH_WAITS_5 | FLASH_CACHES);
    if (!await(FLASH, FLASH_WAITS, FLASH_WAITS_5))
        return TACT_NO_CLOCK;
    tact_set(RCC + RCC_CONFIGURE, APB1_BY_4 | APB2_BY_2);
    tact_set(RCC + RCC_CONFIGURE, APB1_BY_4 | APB2_BY_2 | SWITCH_TO_PLL);
    if (!await(RCC + RCC_CONFIGURE, SWITCHED, SWITCHED_TO_PLL))
        return TACT_NO_CLOCK;
    return crystal ? 0 : TACT_MISSING_CRYSTAL;
}

uint32_t tact_chip_cycles(void)
{
    return tact_get(DWT + DWT_CYCLES);
}
