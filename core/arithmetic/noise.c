#include "arithmetic/noise.h"

/* A bijection of 32 bits that leaves no trace of a counter: two multiplications and three shifts. */
static uint32_t mixed(uint32_t value)
{
    value = (value ^ (value >> 16)) * 0x7feb352du;
    value = (value ^ (value >> 15)) * 0x846ca68bu;
    return value ^ (value >> 16);
}

void tact_noise_seed(tact_noise *noise, uint32_t seed, uint32_t channel)
{
    for (uint32_t i = 0; i < 4; i++)
        noise->word[i] = mixed(seed + mixed(channel + mixed(i + 1u)));
    noise->word[0] |= 1u; /* never all zero */
    for (int i = 0; i < 16; i++)
        (void)tact_noise_bits(noise);
}
