#include "cortex_m/systick.h"

#include "cortex_m/interrupts.h"
#include "cortex_m/registers.h"

#define CONTROL 0xE000E010u
#define RELOAD 0xE000E014u
#define VALUE 0xE000E018u
#define PRIORITIES 0xE000ED20u /* SysTick's is the highest byte */
#define PENDING 0xE000ED04u

enum { PENDS_SYSTICK = 1 << 26 };
enum { ENABLED = 1, COUNTS = 5, RUNS = 7, WRAPPED = 1 << 16, LONGEST = 0xffffff };

static void (*volatile the_tick)(void);
static volatile uint32_t runs, missed, lateness; /* runs: CONTROL while time goes on */

void tact_systick_start(uint32_t clocks, void (*tick)(void))
{
    tact_set(CONTROL, 0);
    the_tick = tick;
    tact_set(PRIORITIES, (tact_get(PRIORITIES) & 0xffffffu) | (uint32_t)TACT_TIMER_PRIORITY << 24);
    tact_set(RELOAD, clocks - 1u);
    tact_set(VALUE, 0);
    runs = RUNS;
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

void tact_systick_stand(void)
{
    tact_set(CONTROL, runs & ~(uint32_t)ENABLED);
}

void tact_systick_go_on(void)
{
    tact_set(CONTROL, runs);
}

void tact_systick_leap(void)
{
    tact_set(VALUE, 0);
    tact_set(PENDING, PENDS_SYSTICK);
    tact_interrupts_come();
}

int tact_systick_goes(void)
{
    return (tact_get(CONTROL) & ENABLED) != 0;
}

void tact_systick_count(void)
{
    tact_set(CONTROL, 0);
    tact_set(RELOAD, LONGEST);
    tact_set(VALUE, 0);
    runs = COUNTS;
    tact_set(CONTROL, COUNTS);
}

uint32_t tact_systick_left(void)
{
    return tact_get(VALUE);
}
