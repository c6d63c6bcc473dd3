#include "board/image.h"

#include "board/sealed.h"
#include "wire/bytes.h"

#define COEFFICIENT_MAX 1e6f
#define COMMAND_LIMIT_MAX 31.0f
#define TOUCH_MAX 1e20f

/* Roots of d^2 + a1 d + a2 with |1 + d| < 1, or <= 1 where `marginal` (Jury's conditions, written for d). */
static int is_stable(double a1, double a2, int marginal)
{
    const double slack = marginal ? 1e-9 : 0.0;
    return (marginal ? a2 >= 0.0 : a2 > 0.0) && (marginal ? a1 - a2 >= 0.0 : a1 - a2 > 0.0) && 4.0 - 2.0 * a1 + a2 > 0.0 &&
           a1 - a2 < 2.0 + slack;
}

static int in_range(float value)
{
    return tact_is_number(value) && value < COEFFICIENT_MAX && value > -COEFFICIENT_MAX;
}

static int32_t read_sections(tact_reader *reader, tact_section *sections, int32_t count, int marginal)
{
    for (int32_t i = 0; i < count; i++) {
        float value[5];
        for (int j = 0; j < 5; j++) {
            value[j] = tact_read_f32(reader);
            if (!in_range(value[j]))
                return TACT_IMAGE_COEFFICIENT;
        }
        if (!is_stable((double)value[3], (double)value[4], marginal))
            return TACT_IMAGE_UNSTABLE_SECTION;
        const tact_section section = {value[0], value[1], value[2], value[3], value[4]};
        sections[i] = section;
    }
    return TACT_IMAGE_GOOD;
}

static double power_of_half(int shift)
{
    double value = 1.0;
    for (int i = 0; i < shift; i++)
        value *= 0.5;
    return value;
}

static int32_t read_sections_q31(tact_reader *reader, tact_section_q31 *sections, int32_t count, int marginal)
{
    for (int32_t i = 0; i < count; i++) {
        int32_t value[5];
        uint8_t shift[4];
        for (int j = 0; j < 5; j++) {
            value[j] = tact_read_i32(reader);
            if (value[j] == INT32_MIN)
                return TACT_IMAGE_COEFFICIENT;
        }
        tact_read_bytes(reader, shift, 4);
        for (int j = 0; j < 3; j++)
            if (shift[j] < TACT_Q31_SHIFT_MIN || shift[j] > TACT_Q31_SHIFT_MAX)
                return TACT_IMAGE_COEFFICIENT;
        const double a1 = value[3] * power_of_half(TACT_Q31_EXTRA + shift[1]);
        const double a2 = value[4] * power_of_half(TACT_Q31_EXTRA + shift[2]);
        if (!is_stable(a1, a2, marginal))
            return TACT_IMAGE_UNSTABLE_SECTION;
        const tact_section_q31 section = {value[0], value[1], value[2], value[3], value[4],
                                          shift[0], shift[1], shift[2], 0};
        sections[i] = section;
    }
    return TACT_IMAGE_GOOD;
}

static int32_t read_single(tact_reader *reader, tact_controller *table, int32_t prefilters, int32_t feedbacks,
                           float limit_v)
{
    table->prefilter_count = prefilters;
    table->feedback_count = feedbacks;
    table->command_max_v = limit_v;
    table->command_min_v = -limit_v;
    for (int i = 0; i < 2; i++) {
        table->anti_windup[i] = tact_read_f32(reader);
        if (!in_range(table->anti_windup[i]))
            return TACT_IMAGE_COEFFICIENT;
    }
    table->conditioning = tact_read_f32(reader);
    table->reference_max = tact_read_f32(reader);
    if (!in_range(table->conditioning) || !in_range(table->reference_max) || table->reference_max < 0.0f)
        return TACT_IMAGE_COEFFICIENT;
    const int32_t refusal = read_sections(reader, table->prefilter, prefilters, 0);
    return refusal ? refusal : read_sections(reader, table->feedback, feedbacks, 1);
}

static int32_t read_q31(tact_reader *reader, tact_controller_q31 *table, int32_t prefilters, int32_t feedbacks,
                        float limit_v)
{
    const int32_t most = (int32_t)1 << 30;
    uint8_t shift[4];
    table->prefilter_count = prefilters;
    table->feedback_count = feedbacks;
    table->command_max = tact_q31_of(limit_v, TACT_Q31_PER_VOLT);
    for (int i = 0; i < 3; i++)
        table->unwinding[i] = tact_read_i32(reader);
    table->reference_max = tact_read_i32(reader);
    tact_read_bytes(reader, shift, 4);
    for (int i = 0; i < 3; i++) {
        const int32_t greatest = i < 2 ? TACT_Q31_SHIFT_MAX : TACT_Q31_CONDITIONING_SHIFT_MAX;
        table->unwinding_shift[i] = shift[i];
        if (shift[i] < TACT_Q31_SHIFT_MIN || shift[i] > greatest || table->unwinding[i] > most ||
            table->unwinding[i] < -most)
            return TACT_IMAGE_COEFFICIENT;
    }
    if (table->reference_max < 0)
        return TACT_IMAGE_COEFFICIENT;
    const int32_t refusal = read_sections_q31(reader, table->prefilter, prefilters, 0);
    return refusal ? refusal : read_sections_q31(reader, table->feedback, feedbacks, 1);
}

static int32_t read_touch_floats(tact_reader *reader, float *to, int32_t count)
{
    for (int32_t i = 0; i < count; i++) {
        to[i] = tact_read_f32(reader);
        if (!tact_is_number(to[i]) || to[i] > TOUCH_MAX || to[i] < -TOUCH_MAX)
            return TACT_IMAGE_COEFFICIENT;
    }
    return TACT_IMAGE_GOOD;
}

/* How a channel feeds forward: its own copy of C's sections among it. */
static int32_t read_touch(tact_reader *reader, tact_touch *touch, int32_t feedbacks)
{
    touch->feedback_count = feedbacks;
    touch->delay = tact_read_u8(reader);
    touch->turns = tact_read_u8(reader);
    touch->turn = tact_read_u8(reader);
    touch->hum_count = tact_read_u8(reader);
    struct {
        float *to;
        int32_t count;
    } const parts[] = {{touch->plant, 4},       {&touch->corner, 1},     {touch->command, 2}, {touch->position, 3},
                       {touch->mass, 3},        {touch->rest, 2},        {touch->first, 3},   {touch->second, 3},
                       {&touch->slow, 1},       {&touch->forgetting, 1}, {&touch->gate, 1},   {&touch->ridge, 1},
                       {&touch->shape, 1},      {&touch->fading, 1},     {&touch->slew, 1},   {&touch->weight_max, 1},
                       {&touch->push_max_v, 1}, {&touch->hum_gain, 1}};
    int32_t refusal = TACT_IMAGE_GOOD;
    for (size_t i = 0; i < sizeof parts / sizeof *parts && !refusal; i++)
        refusal = read_touch_floats(reader, parts[i].to, parts[i].count);
    if (!refusal)
        refusal = read_sections(reader, touch->feedback, feedbacks, 1);
    if (refusal)
        return refusal;
    if (!tact_touch_settle(touch))
        return TACT_IMAGE_COEFFICIENT;
    return read_touch_floats(reader, touch->hum[0], 2 * touch->hum_count);
}

static int32_t read_strength(tact_reader *reader, tact_strength *strength)
{
    float *const row = strength->gain[0];
    strength->follow = tact_read_f32(reader);
    strength->damping = tact_read_f32(reader);
    for (int i = 0; i < TACT_STRENGTH_PAIRS; i++)
        strength->turn[i] = tact_read_f32(reader);
    for (int i = 0; i < TACT_STRENGTH_LEVELS * TACT_STRENGTH_GAINS; i++)
        row[i] = tact_read_f32(reader);
    strength->is_on = 1;
    return tact_strength_is_valid(strength) ? TACT_IMAGE_GOOD : TACT_IMAGE_COEFFICIENT;
}

static int32_t read_tables(tact_reader *reader, tact_image *image, int32_t channel, int32_t prefilters,
                           int32_t feedbacks, float limit_v)
{
    if (image->format == TACT_FLOAT32)
        return read_single(reader, &image->tables.single[channel], prefilters, feedbacks, limit_v);
    return read_q31(reader, &image->tables.q31[channel], prefilters, feedbacks, limit_v);
}

static int32_t read_channel(tact_reader *reader, tact_image *image, int32_t channel)
{
    tact_read_bytes(reader, image->names[channel], TACT_NAME_SIZE);
    const int32_t prefilters = tact_read_u8(reader), feedbacks = tact_read_u8(reader);
    const int32_t touch = tact_read_u8(reader), strength = tact_read_u8(reader);
    if ((touch != 0 && touch != TACT_TOUCH_LAYOUT) || (strength != 0 && strength != TACT_STRENGTH_LAYOUT))
        return TACT_IMAGE_VERSION_UNKNOWN;
    if (prefilters < 1 || prefilters > TACT_PREFILTER_MAX || feedbacks > TACT_FEEDBACK_MAX)
        return TACT_IMAGE_SECTIONS;
    const float limit_v = tact_read_f32(reader);
    if (!(limit_v > 0.0f && limit_v < COMMAND_LIMIT_MAX))
        return TACT_IMAGE_LIMIT;
    int32_t refusal = read_tables(reader, image, channel, prefilters, feedbacks, limit_v);
    image->adapts += touch != 0;
    image->touch[channel].feedback_count = 0;
    image->strength[channel].is_on = 0;
    if (!refusal && touch)
        refusal = read_touch(reader, &image->touch[channel], feedbacks);
    return refusal || !strength ? refusal : read_strength(reader, &image->strength[channel]);
}

static int32_t read_header(tact_reader *reader, tact_image *image)
{
    reader->at = 6;
    image->format = tact_read_u16(reader);
    (void)tact_read_u32(reader);
    image->rate_hz = tact_read_f32(reader);
    image->delay_samples = tact_read_u8(reader);
    image->channels = tact_read_u8(reader);
    const uint16_t reserved = tact_read_u16(reader);
    tact_read_bytes(reader, image->hash, TACT_HASH_SIZE);
    return reader->overrun || reserved != 0 ? TACT_IMAGE_TRUNCATED : TACT_IMAGE_GOOD;
}

int32_t tact_image_parse(tact_image *image, const uint8_t *bytes, size_t size, float rate_hz, int32_t delay_samples,
                         int32_t channels)
{
    const tact_sealed_kind kind = {TACT_IMAGE_MAGIC, TACT_IMAGE_VERSION, TACT_IMAGE_MAX};
    int32_t refusal = tact_sealed_check(&kind, bytes, size);
    if (refusal)
        return refusal;
    tact_reader reader = {bytes, size - 4, 0, 0};
    refusal = read_header(&reader, image);
    if (refusal)
        return refusal;
    if (image->format != TACT_FLOAT32 && image->format != TACT_Q31)
        return TACT_IMAGE_FORMAT;
    if (image->rate_hz != rate_hz)
        return TACT_IMAGE_RATE;
    if (image->delay_samples != delay_samples)
        return TACT_IMAGE_DELAY;
    if (image->channels != channels || channels < 1 || channels > TACT_CHANNELS_MAX)
        return TACT_IMAGE_CHANNELS;
    image->adapts = 0;
    for (int32_t c = 0; c < channels; c++) {
        refusal = read_channel(&reader, image, c);
        if (refusal)
            return reader.overrun ? TACT_IMAGE_TRUNCATED : refusal;
    }
    if (reader.overrun || reader.at != size - 4)
        return TACT_IMAGE_TRUNCATED;
    reader = (tact_reader){bytes, size, size - 4, 0};
    image->crc = tact_read_u32(&reader);
    return TACT_IMAGE_GOOD;
}
