#include "stm32f405/silicon/cycles.h"

#include "stm32f405/registers.h"
#include "cortex_m/interrupts.h"

enum { TRACE_ON = 1 << 24, CYCLES_ON = 1, MOST_PERIODS = 1000000 };

static volatile uint32_t asked, wanted, counted, before, least, most, sum; /* asked: by the main loop alone */

void tact_cycles_start(void)
{
    tact_set(DEBUG_TRACE, tact_get(DEBUG_TRACE) | TRACE_ON);
    tact_set(DWT + DWT_CYCLES, 0);
    tact_set(DWT + DWT_CONTROL, tact_get(DWT + DWT_CONTROL) | CYCLES_ON);
}

void tact_cycles_from(void)
{
    before = tact_get(DWT + DWT_CYCLES);
}

void tact_cycles_to(void)
{
    const uint32_t taken = tact_get(DWT + DWT_CYCLES) - before; /* the counter may have gone round once */
    if (counted == wanted)
        return;
    counted = counted + 1u;
    least = taken < least ? taken : least;
    most = taken > most ? taken : most;
    sum = sum + taken;
}

void tact_cycles_count(uint32_t periods, uint32_t *counts)
{
    const uint32_t kept_out = tact_interrupts_enter();
    if (periods != asked) {
        asked = periods;
        wanted = periods < MOST_PERIODS ? periods : MOST_PERIODS;
        counted = most = sum = 0;
        least = UINT32_MAX;
    }
    const int is_whole = counted == wanted && wanted != 0;
    counts[0] = is_whole ? least : 0;
    counts[1] = is_whole ? most : 0;
    counts[2] = is_whole ? sum : 0;
    tact_interrupts_leave(kept_out);
}
