/* Image: the controllers of all channels as bytes, checked before any of it is used.
 *
 *     magic "TACI" | version 4 | channels, delay | length | rate_hz | hash of controller.json (32)
 *     then for each channel: name (16) | prefilter sections, feedback sections, touch, strength | command_limit_v |
 *                            unwinding | sections | where touch is not 0 but 3, the number of this layout, how
 *                            it feeds forward for a finger (touch/table.h): delay, turns, turn, lines of hum (a byte
 *                            each) | plant, corner, command, position, mass, rest, first, second, slow, forgetting,
 *                            gate, ridge, shape, fading, slew, weight_max, push_max_v, hum_gain | hum | where
 *                            strength is not 0 but 1, the number of this layout, how its reference is reshaped
 *                            (strength/strength.h): follow, damping, turns, rows of gains
 *     CRC-32 of all before
 *
 * All little-endian, numbers float32. Unwinding: anti-windup's two gains, conditioning, reference_max (controller.h).
 * A section: b0 b1 b2 a1 a2 in delta form (section.h).
 *
 * Refused: anything truncated, flipped, of another version, rate, delay or number of channels; coefficients that are
 * not numbers or out of range; a prefilter section with a pole on or outside the unit circle, a feedback section with
 * one outside. Whether the *loop* is stable is for `check` on the host; the guard watches whatever runs.
 *
 * Example use:
 *   tact_image image;
 *   int refusal = tact_image_parse(&image, bytes, size, 4000.0f, 1, 3);
 *   if (refusal == TACT_IMAGE_GOOD) run(&image);
 */
#ifndef TACT_IMAGE_H
#define TACT_IMAGE_H

#include <stddef.h>
#include <stdint.h>

#include "control/controller.h"
#include "strength/strength.h"
#include "wire/bytes.h"

enum { TACT_CHANNELS_MAX = 4, TACT_NAME_SIZE = 16, TACT_HASH_SIZE = 32 };
enum { TACT_IMAGE_VERSION = 4, TACT_IMAGE_MAGIC = 0x49434154, TACT_IMAGE_MAX = 8192 };
enum { TACT_TOUCH_LAYOUT = 3, TACT_STRENGTH_LAYOUT = 1 };

typedef enum {
    TACT_IMAGE_GOOD = 0,
    TACT_IMAGE_TRUNCATED,
    TACT_IMAGE_NOT_ONE,
    TACT_IMAGE_VERSION_UNKNOWN,
    TACT_IMAGE_CHECKSUM,
    TACT_IMAGE_RATE,
    TACT_IMAGE_DELAY,
    TACT_IMAGE_CHANNELS,
    TACT_IMAGE_SECTIONS,
    TACT_IMAGE_COEFFICIENT,
    TACT_IMAGE_UNSTABLE_SECTION,
    TACT_IMAGE_LIMIT
} tact_image_refusal;

typedef struct {
    float rate_hz;
    int32_t delay_samples;
    int32_t channels; /* 0: none is loaded */
    uint32_t crc;
    uint8_t hash[TACT_HASH_SIZE];
    uint8_t names[TACT_CHANNELS_MAX][TACT_NAME_SIZE];
    tact_controller controller[TACT_CHANNELS_MAX];
    tact_strength strength[TACT_CHANNELS_MAX];
} tact_image;

/* One channel's part, as it is: TACT_IMAGE_GOOD, or that it cannot be run at all. What a board refuses besides
 * (coefficients and limits out of range, poles outside the unit circle) a simulation may run. */
int32_t tact_image_read_channel(tact_reader *reader, uint8_t *name, tact_controller *controller, tact_strength *strength);

/* TACT_IMAGE_GOOD and the image filled, or why not; then `image` is left in pieces and must not be run. */
int32_t tact_image_parse(tact_image *image, const uint8_t *bytes, size_t size, float rate_hz, int32_t delay_samples,
                         int32_t channels);

#endif
