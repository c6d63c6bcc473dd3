/* MPS2: the processor's own exceptions; the watchdog's interrupt is the one that cannot be masked. */

#include "cortex_m/startup.h"
#include "cortex_m/systick.h"

__attribute__((section(".vectors"), used)) static const tact_vector VECTORS[16] = {
    [0] = (tact_vector)&tact_stack_top,
    [1] = tact_reset,
    [2 ... 14] = tact_halt,
    [15] = tact_systick,
};
