/* White noise from integers: no libm, the same numbers on every processor.
 *
 *     xoshiro128++ --> two words --> four 16-bit uniforms --> (sum - mean) * scale
 *
 * The sum of four uniforms (Irwin-Hall) is a bell of excess kurtosis -0.3 that ends at 3.46 rms. The generator is
 * Blackman and Vigna's xoshiro128++ (2021, ACM TOMS 47, 36), period 2^128 - 1, shifts and additions alone.
 *
 * Example use:
 *   tact_noise noise;
 *   tact_noise_seed(&noise, 1, 0);
 *   double sensor_noise_v = tact_noise_next(&noise) * (0.2e-3 / 37837.0);
 */
#ifndef TACT_NOISE_H
#define TACT_NOISE_H

#include <stddef.h>
#include <stdint.h>

typedef struct {
    uint32_t word[4];
} tact_noise;

static inline uint32_t tact_noise_rotate(uint32_t value, int bits)
{
    return (value << bits) | (value >> (32 - bits));
}

/* 32 random bits. */
static inline uint32_t tact_noise_bits(tact_noise *noise)
{
    uint32_t *s = noise->word;
    const uint32_t bits = tact_noise_rotate(s[0] + s[3], 7) + s[0];
    const uint32_t shifted = s[1] << 9;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= shifted;
    s[3] = tact_noise_rotate(s[3], 11);
    return bits;
}

/* A sum of four uniforms less its mean: rms sqrt((2^32 - 1) / 3), at most 131070 either way. */
static inline double tact_noise_next(tact_noise *noise)
{
    const uint32_t first = tact_noise_bits(noise);
    const uint32_t second = tact_noise_bits(noise);
    const uint32_t sum = (first >> 16) + (first & 0xffffu) + (second >> 16) + (second & 0xffffu);
    return (double)((int32_t)sum - 131070);
}

/* One stream per (seed, channel). */
void tact_noise_seed(tact_noise *noise, uint32_t seed, uint32_t channel);

#endif
