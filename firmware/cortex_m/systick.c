#include "cortex_m/systick.h"

#include "cortex_m/interrupts.h"
#include "cortex_m/registers.h"

#define CONTROL 0xE000E010u
#define RELOAD 0xE000E014u
#define VALUE 0xE000E018u
#define PRIORITIES 0xE000ED20u /* SysTick's is the highest byte */

enum { RUNS = 7, WRAPPED = 1 << 16 };

static void (*volatile the_tick)(void);
static volatile uint32_t missed, lateness;

void tact_systick_start(uint32_t clocks, void (*tick)(void))
{
    tact_set(CONTROL, 0);
    the_tick = tick;
    tact_set(PRIORITIES, (tact_get(PRIORITIES) & 0xffffffu) | (uint32_t)TACT_TIMER_PRIORITY << 24);
    tact_set(RELOAD, clocks - 1u);
    tact_set(VALUE, 0);
    tact_set(CONTROL, RUNS);
}

void tact_systick(void)
{
    const uint32_t reload = tact_get(RELOAD), value = tact_get(VALUE); /* reads 0 at the wrap itself */
    (void)tact_get(CONTROL); /* takes back the mark of the wrap that brought us here */
    lateness = (value == 0 ? 0 : reload - value) * 256u / (reload + 1u) + missed;
    the_tick();
    missed = tact_get(CONTROL) & WRAPPED ? 256u : 0u;
}

uint32_t tact_systick_lateness(void)
{
    return lateness;
}
