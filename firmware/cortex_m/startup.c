/* Nothing of a library. */

#include "cortex_m/startup.h"

#include <stddef.h>

#include "cortex_m/processor.h"
#include "port.h"

extern uint32_t tact_vectors, tact_data_from, tact_data_begin, tact_data_end, tact_bss_begin, tact_bss_end;

int main(void);
void *memcpy(void *to, const void *from, size_t size);
void *memset(void *to, int value, size_t size);
void tact_halt_here(void);

/* The compiler calls these for structures, even freestanding. */
__attribute__((used)) void *memcpy(void *to, const void *from, size_t size)
{
    uint8_t *target = to;
    const uint8_t *source = from;
    while (size--)
        *target++ = *source++;
    return to;
}

__attribute__((used)) void *memset(void *to, int value, size_t size)
{
    uint8_t *target = to;
    while (size--)
        *target++ = (uint8_t)value;
    return to;
}

__attribute__((used)) void tact_halt_here(void)
{
    tact_port_outputs_safe();
    for (;;) {
    }
}

/* The stack may be what is broken. */
__attribute__((naked, used)) void tact_halt(void)
{
    __asm volatile("cpsid i\n movw r0, #:lower16:tact_stack_top\n movt r0, #:upper16:tact_stack_top\n"
                   " mov sp, r0\n b tact_halt_here");
}

__attribute__((used, noreturn)) static void begin_here(void)
{
    tact_processor_begin((uint32_t)(uintptr_t)&tact_vectors);
    __asm volatile("dsb\n isb" ::: "memory");
    for (uint32_t *from = &tact_data_from, *to = &tact_data_begin; to < &tact_data_end;)
        *to++ = *from++;
    for (uint32_t *at = &tact_bss_begin; at < &tact_bss_end;)
        *at++ = 0;
    __asm volatile("msr basepri, %0\n cpsie i\n cpsie f" ::"r"(0) : "memory");
    (void)main();
    tact_halt_here();
    __builtin_unreachable();
}

/* A bootloader may have left another stack, interrupts masked, or the process stack in use. */
__attribute__((naked, used)) void tact_reset(void)
{
    __asm volatile("cpsid i\n movs r0, #0\n msr control, r0\n isb\n"
                   " movw r0, #:lower16:tact_stack_top\n movt r0, #:upper16:tact_stack_top\n mov sp, r0\n b begin_here");
}
