#include "board/bit_check.h"

#include "wire/crc32.h"

enum { KINDS = 9 };

static float of_bits(uint32_t bits)
{
    const union {
        uint32_t bits;
        float value;
    } both = {bits};
    return both.value;
}

/* Within +/- 1, 24 bits. */
static float uniform(tact_noise *noise)
{
    return (float)((int32_t)(tact_noise_bits(noise) >> 8) - 8388608) * (1.0f / 8388608.0f);
}

static float sample(tact_bit_check *check, float full, float before)
{
    tact_noise *noise = &check->noise;
    const uint32_t bits = tact_noise_bits(noise);
    switch (check->kind) {
    case 0:
        return full * uniform(noise);
    case 1:
        return bits & 1u ? full : -full;
    case 2: /* subnormal */
        return of_bits(bits & 0x807fffffu);
    case 3: /* a step now and then */
        return (bits & 63u) == 0 ? full * uniform(noise) : before;
    case 4:
        return bits & 0x80000000u ? 0.0f : -0.0f;
    case 5: /* one bit of a converter */
        return (float)((int32_t)(bits & 2u) - 1) * (10.0f / 32768.0f);
    case 6: /* any number at all, NaN and infinities among them */
        return of_bits(bits);
    case 7: /* just above and below what is taken for zero */
        return of_bits(0x0da24260u + (bits & 255u) - 128u);
    default:
        return 1e-3f * full * uniform(noise);
    }
}

void tact_bit_check_begin(tact_bit_check *check, const tact_image *image, uint32_t seed)
{
    tact_noise_seed(&check->noise, seed, 0);
    check->left = check->kind = check->digest = 0;
    for (int32_t c = 0; c < TACT_CHANNELS_MAX; c++) {
        check->reference[c] = check->position_v[c] = 0.0f;
        if (image->format == TACT_Q31)
            tact_controller_q31_reset(&check->controller[c].q31);
        else
            tact_controller_reset(&check->controller[c].single);
    }
}

void tact_bit_check_next(tact_bit_check *check, int32_t channels)
{
    if (check->left == 0) {
        const uint32_t bits = tact_noise_bits(&check->noise);
        check->kind = (bits >> 16) % KINDS;
        check->left = 16u + (bits & 511u);
    }
    check->left--;
    for (int32_t c = 0; c < channels; c++) {
        check->reference[c] = sample(check, 1000.0f, check->reference[c]);
        check->position_v[c] = sample(check, 10.0f, check->position_v[c]);
    }
}

static float answer(tact_bit_check *check, const tact_image *image, int32_t c)
{
    if (image->format == TACT_Q31)
        return tact_controller_q31_step(&image->tables.q31[c], &check->controller[c].q31, check->reference[c],
                                        check->position_v[c]);
    check->controller[c].single.broken = 0;
    return tact_controller_step(&image->tables.single[c], &check->controller[c].single, check->reference[c],
                                tact_finite(check->position_v[c], TACT_POSITION_MAX));
}

static void digest(tact_bit_check *check, float command_v)
{
    union {
        float value;
        uint32_t bits;
    } both;
    both.value = command_v;
    const uint8_t bytes[4] = {(uint8_t)(both.bits & 255u), (uint8_t)(both.bits >> 8 & 255u),
                              (uint8_t)(both.bits >> 16 & 255u), (uint8_t)(both.bits >> 24)};
    check->digest = tact_crc32(check->digest, bytes, 4);
}

uint32_t tact_bit_check_run(tact_bit_check *check, const tact_image *image, uint32_t samples)
{
    for (uint32_t k = 0; k < samples; k++) {
        tact_bit_check_next(check, image->channels);
        for (int32_t c = 0; c < image->channels; c++)
            digest(check, answer(check, image, c));
    }
    return check->digest;
}

uint32_t tact_bit_check_record(tact_bit_check *check, const tact_image *image, uint32_t samples, float *reference,
                              float *position_v, float *command_v)
{
    for (uint32_t k = 0; k < samples; k++) {
        tact_bit_check_next(check, image->channels);
        for (int32_t c = 0; c < image->channels; c++) {
            const uint32_t at = k * (uint32_t)image->channels + (uint32_t)c;
            reference[at] = check->reference[c];
            position_v[at] = check->position_v[c];
            command_v[at] = answer(check, image, c);
            digest(check, command_v[at]);
        }
    }
    return check->digest;
}
