/* Safety table: what the guard holds every image to. The board's own, checksummed, written only in OFF.
 *
 *     magic "TACS" | version 2 | channels, delay | length | rate_hz | lateness_max | silence, soft start, fade, ramp,
 *     quick ramp (ticks) | turns | travel_share |
 *     lock ticks, lock faults | then for each channel the fields of tact_safety_channel in order | CRC-32 of all before
 *
 * Little-endian; integers 32 bits, numbers float32, sections b0 b1 b2 a1 a2 in delta form. Nothing in an image and no
 * frame of the link changes a table while anything moves: a subject's prefilter is a download that leaves it alone.
 *
 * The observer is the plant under a zero-order hold, written so that it costs four products (guard.h draws it):
 *     x' = x + w' + correct_x nu,   w' = w + (drive (m + m_before) - damp w - spring x + correct_w nu),   nu = y - x
 *
 * Example use:
 *   tact_safety table;
 *   if (tact_safety_parse(&table, bytes, size, 3) == TACT_SAFETY_GOOD) guard_with(&table);
 */
#ifndef TACT_SAFETY_H
#define TACT_SAFETY_H

#include <stddef.h>
#include <stdint.h>

#include "arithmetic/converter.h"
#include "board/image.h"
#include "arithmetic/section.h"

enum { TACT_SAFETY_VERSION = 2, TACT_SAFETY_MAGIC = 0x53434154, TACT_SAFETY_MAX = 1024, TACT_WEIGHTING_COUNT = 2 };
enum { TACT_SAFETY_NEVER = 1 << 20 }; /* ticks */

typedef enum {
    TACT_SAFETY_GOOD = 0,
    TACT_SAFETY_TRUNCATED,
    TACT_SAFETY_NOT_ONE,
    TACT_SAFETY_VERSION_UNKNOWN,
    TACT_SAFETY_CHECKSUM,
    TACT_SAFETY_CHANNELS,
    TACT_SAFETY_NUMBER
} tact_safety_refusal;

typedef struct {
    tact_converter converter; /* in the file: bits, polarity (integers), range_v, offset_v */
    int32_t position_code_max; /* a reading beyond it: the sensor is open */
    int32_t frozen_ticks;      /* the same reading for as long: the sensor is frozen; 2^20: never */
    float stop_max_v;          /* predicted place of rest, volts of y */
    float stop_lead;           /* coasting: volts of y per volt a tick */
    float command_max_v;       /* drawn in to what the D/A reaches */
    float reference_max;       /* threshold units */
    float comfort_max;         /* threshold units, felt */
    float disagreement_v;      /* |nu| beyond it: the sensor disagrees with the plant */
    float reversal_power;      /* mean square of w from turn to turn, above which motion is compared with the plant's */
    float drive, damp, spring, correct_x, correct_w;
    int32_t still_codes;       /* a reading within so many codes is constant; it is stuck if the motor should have */
    float stray_max_v;         /* moved by so much meanwhile, volts of y */
    float jump_v;              /* most that the reading's unexplained motion changes by, from one turn to the next but one, */
    float jump_share;          /* besides this share of the model's own change */
    float travel_max;          /* of the reference's slow part, threshold units */
    tact_section weighting[TACT_WEIGHTING_COUNT]; /* y to felt reference: the designed H, inverted up to the band's end */
} tact_safety_channel;

typedef struct {
    int32_t channels; /* 0: there is no table */
    int32_t delay_samples;
    float rate_hz;
    int32_t lateness_max; /* 1/256 of a period */
    int32_t silence_ticks, soft_start_ticks, fade_ticks, ramp_ticks, quick_ticks;
    int32_t turns; /* each channel is compared every so many ticks, and its weighting runs at that rate */
    float travel_share; /* of the reference, into its slow part, a tick: the rest stays */
    int32_t lock_ticks, lock_faults; /* after a sensor or travel fault no clear for so long; after so many no arm */
    uint32_t crc;
    tact_safety_channel channel[TACT_CHANNELS_MAX];
} tact_safety;

/* TACT_SAFETY_GOOD and the table filled, or why not; then `table` is left in pieces. channels_max: of the board. */
int32_t tact_safety_parse(tact_safety *table, const uint8_t *bytes, size_t size, int32_t channels_max);

#endif
