/* Bit check: samples that look for differences between processors, and a digest of what comes of them.
 *
 * References and positions come from integers (xoshiro128++) in stretches: full scale, noise, subnormals, steps,
 * silence, single bits, huge and tiny numbers, NaN and infinities. The digest is a CRC-32 over the bits of every
 * command of every channel: host and target agree in one number, or differ somewhere.
 *
 * Example use:
 *   tact_bit_check check;
 *   tact_bit_check_begin(&check, &image, 1);
 *   uint32_t digest = tact_bit_check_run(&check, &image, 1000000);
 */
#ifndef TACT_BIT_CHECK_H
#define TACT_BIT_CHECK_H

#include <stdint.h>

#include "board/board.h"
#include "arithmetic/noise.h"

typedef struct {
    tact_noise noise;
    uint32_t left, kind; /* of the stretch */
    uint32_t digest;
    float reference[TACT_CHANNELS_MAX], position_v[TACT_CHANNELS_MAX];
    tact_board_controller_state controller[TACT_CHANNELS_MAX];
} tact_bit_check;

void tact_bit_check_begin(tact_bit_check *check, const tact_image *image, uint32_t seed);

/* The next reference and position of every channel. */
void tact_bit_check_next(tact_bit_check *check, int32_t channels);

/* samples more through the image's controllers; the digest of all since the beginning. */
uint32_t tact_bit_check_run(tact_bit_check *check, const tact_image *image, uint32_t samples);

/* The same, and the inputs and commands themselves, (samples, channels) each: for tests. */
uint32_t tact_bit_check_record(tact_bit_check *check, const tact_image *image, uint32_t samples, float *reference,
                              float *position_v, float *command_v);

#endif
