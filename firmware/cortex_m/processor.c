#include "cortex_m/processor.h"

#include "cortex_m/registers.h"

#define SYSTICK_CONTROL 0xE000E010u
#define NVIC_DISABLE 0xE000E180u
#define NVIC_UNPEND 0xE000E280u
#define PENDING 0xE000ED04u /* ICSR */
#define VECTORS 0xE000ED08u /* VTOR */
#define ACCESS 0xE000ED88u  /* CPACR */

enum { NVIC_WORDS = 8, UNPENDS_SYSTICK = 1 << 25, FLOATING_POINT = 0xF << 20 };

void tact_processor_begin(uint32_t vectors)
{
    tact_set(SYSTICK_CONTROL, 0);
    for (uint32_t word = 0; word < NVIC_WORDS; word++) {
        tact_set(NVIC_DISABLE + 4u * word, 0xFFFFFFFFu);
        tact_set(NVIC_UNPEND + 4u * word, 0xFFFFFFFFu);
    }
    tact_set(PENDING, UNPENDS_SYSTICK);
    tact_set(VECTORS, vectors);
    tact_set(ACCESS, tact_get(ACCESS) | FLOATING_POINT);
}
