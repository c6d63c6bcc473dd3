/* Cortex-M from reset to main(): vectors, memory, floating point. Nothing of a library. */

#include <stddef.h>
#include <stdint.h>

extern uint32_t tact_stack_top, tact_data_from, tact_data_begin, tact_data_end, tact_bss_begin, tact_bss_end;

int main(void);
void tact_reset(void);
void tact_systick(void);
void *memcpy(void *to, const void *from, size_t size);
void *memset(void *to, int value, size_t size);

/* A fault of the processor ends here, where a watchdog finds it. */
static void stuck(void)
{
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static void (*const VECTORS[16])(void) = {
    [0] = (void (*)(void))&tact_stack_top,
    [1] = tact_reset,
    [2] = stuck,
    [3] = stuck,
    [4] = stuck,
    [5] = stuck,
    [6] = stuck,
    [11] = stuck,
    [14] = stuck,
    [15] = tact_systick,
};

/* The compiler calls these for structures, even freestanding. */
void *memcpy(void *to, const void *from, size_t size)
{
    uint8_t *target = to;
    const uint8_t *source = from;
    while (size--)
        *target++ = *source++;
    return to;
}

void *memset(void *to, int value, size_t size)
{
    uint8_t *target = to;
    while (size--)
        *target++ = (uint8_t)value;
    return to;
}

void tact_reset(void)
{
    volatile uint32_t *const access = (volatile uint32_t *)0xE000ED88u; /* CPACR: the floating-point unit */
    *access |= 0xFu << 20;
    __asm volatile("dsb\n isb" ::: "memory");
    for (uint32_t *from = &tact_data_from, *to = &tact_data_begin; to < &tact_data_end;)
        *to++ = *from++;
    for (uint32_t *at = &tact_bss_begin; at < &tact_bss_end;)
        *at++ = 0;
    (void)main();
    stuck();
}
