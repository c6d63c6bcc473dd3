#include "cortex_m/interrupts.h"

uint32_t tact_interrupts_enter(void)
{
    uint32_t before;
    __asm volatile("mrs %0, basepri\n msr basepri, %1" : "=&r"(before) : "r"(TACT_TIMER_PRIORITY) : "memory");
    return before;
}

void tact_interrupts_leave(uint32_t before)
{
    __asm volatile("msr basepri, %0" ::"r"(before) : "memory");
}

void tact_sleep(void)
{
    __asm volatile("wfi" ::: "memory");
}

/* An interrupt that is kept out ends the sleep all the same, and comes in after it. */
void tact_sleep_unless(int (*reason)(void))
{
    __asm volatile("cpsid i" ::: "memory");
    if (!reason())
        tact_sleep();
    __asm volatile("cpsie i" ::: "memory");
}
