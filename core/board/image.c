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

static int32_t read_controller(tact_reader *reader, tact_controller *table, int32_t prefilters, int32_t feedbacks,
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
    int32_t refusal = read_controller(reader, &image->controller[channel], prefilters, feedbacks, limit_v);
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
    image->channels = tact_read_u8(reader);
    image->delay_samples = tact_read_u8(reader);
    (void)tact_read_u32(reader);
    image->rate_hz = tact_read_f32(reader);
    tact_read_bytes(reader, image->hash, TACT_HASH_SIZE);
    return reader->overrun ? TACT_IMAGE_TRUNCATED : TACT_IMAGE_GOOD;
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
