/* Registers by function, so that a test can put a model of the chip in their place: with TACT_MODELLED they are functions
 * of the test's.
 *
 * Example use:
 *   tact_set(SYSTICK_CONTROL, 7);
 */
#ifndef TACT_CORTEX_M_REGISTERS_H
#define TACT_CORTEX_M_REGISTERS_H

#include <stdint.h>

#ifdef TACT_MODELLED
uint32_t tact_get(uint32_t address);
void tact_set(uint32_t address, uint32_t value);
#else
static inline uint32_t tact_get(uint32_t address)
{
    return *(volatile uint32_t *)(uintptr_t)address;
}

static inline void tact_set(uint32_t address, uint32_t value)
{
    *(volatile uint32_t *)(uintptr_t)address = value;
}
#endif

#endif
