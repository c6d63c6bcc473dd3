#include "board/image.h"

#include "board/sealed.h"

#define COEFFICIENT_MAX 1e6f
#define COMMAND_LIMIT_MAX 31.0f
#define TOUCH_MAX 1e20f

static void read_floats(tact_reader *reader, float *to, int32_t count)
{
    for (int32_t i = 0; i < count; i++)
        to[i] = tact_read_f32(reader);
}

static void read_sections(tact_reader *reader, tact_section *sections, int32_t count)
{
    for (int32_t i = 0; i < count; i++) {
        float value[5];
        read_floats(reader, value, 5);
        sections[i] = (tact_section){value[0], value[1], value[2], value[3], value[4]};
    }
}

static int is_within(const float *values, int32_t count, float most)
{
    int within = 1;
    for (int32_t i = 0; i < count; i++)
        within &= __builtin_fabsf(values[i]) < most; /* NaN fails */
    return within;
}

static int read_touch(tact_reader *reader, tact_touch *touch)
{
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
                       {&touch->push_max_v, 1}, {&touch->hum_gain, 1},   {touch->hum[0], 2 * touch->hum_count}};
    int within = touch->hum_count <= TACT_TOUCH_HUM_MAX;
    for (size_t i = 0; i < sizeof parts / sizeof *parts && within; i++) {
        read_floats(reader, parts[i].to, parts[i].count);
        within = is_within(parts[i].to, parts[i].count, TOUCH_MAX);
    }
    return within && tact_touch_is_valid(touch);
}

static int read_strength(tact_reader *reader, tact_strength *strength)
{
    strength->is_on = 1;
    strength->follow = tact_read_f32(reader);
    strength->damping = tact_read_f32(reader);
    read_floats(reader, strength->turn, TACT_STRENGTH_PAIRS);
    read_floats(reader, strength->gain[0], TACT_STRENGTH_LEVELS * TACT_STRENGTH_GAINS);
    return tact_strength_is_valid(strength);
}

int32_t tact_image_read_channel(tact_reader *reader, uint8_t *name, tact_controller *controller, tact_strength *strength)
{
    tact_read_bytes(reader, name, TACT_NAME_SIZE);
    controller->prefilter_count = tact_read_u8(reader);
    controller->feedback_count = tact_read_u8(reader);
    const int32_t touch = tact_read_u8(reader), reshapes = tact_read_u8(reader);
    if ((touch != 0 && touch != TACT_TOUCH_LAYOUT) || (reshapes != 0 && reshapes != TACT_STRENGTH_LAYOUT))
        return TACT_IMAGE_VERSION_UNKNOWN;
    if (controller->prefilter_count < 1 || controller->prefilter_count > TACT_PREFILTER_MAX ||
        controller->feedback_count > TACT_FEEDBACK_MAX || (touch && !controller->feedback_count))
        return TACT_IMAGE_SECTIONS;
    controller->command_max_v = tact_read_f32(reader);
    if (!(controller->command_max_v > 0.0f))
        return TACT_IMAGE_LIMIT;
    read_floats(reader, controller->anti_windup, 2);
    controller->conditioning = tact_read_f32(reader);
    controller->reference_max = tact_read_f32(reader);
    read_sections(reader, controller->prefilter, controller->prefilter_count);
    read_sections(reader, controller->feedback, controller->feedback_count);
    controller->touch.delay = strength->is_on = 0;
    if ((touch && !read_touch(reader, &controller->touch)) || (reshapes && !read_strength(reader, strength)))
        return TACT_IMAGE_COEFFICIENT;
    return TACT_IMAGE_GOOD;
}

/* Roots of d^2 + a1 d + a2 with |1 + d| < 1, or <= 1 where `marginal` (Jury's conditions, written for d). */
static int is_stable(const tact_section *section, int marginal)
{
    const double a1 = (double)section->a1, a2 = (double)section->a2, slack = marginal ? 1e-9 : 0.0;
    return (marginal ? a2 >= 0.0 : a2 > 0.0) && (marginal ? a1 - a2 >= 0.0 : a1 - a2 > 0.0) && 4.0 - 2.0 * a1 + a2 > 0.0 &&
           a1 - a2 < 2.0 + slack;
}

static int32_t judge_sections(const tact_section *sections, int32_t count, int marginal)
{
    for (int32_t i = 0; i < count; i++) {
        if (!is_within(&sections[i].b0, 5, COEFFICIENT_MAX))
            return TACT_IMAGE_COEFFICIENT;
        if (!is_stable(&sections[i], marginal))
            return TACT_IMAGE_UNSTABLE_SECTION;
    }
    return TACT_IMAGE_GOOD;
}

/* What a board refuses of a controller that could be run. */
static int32_t judge(const tact_controller *controller)
{
    const float unwinding[] = {controller->anti_windup[0], controller->anti_windup[1], controller->conditioning,
                               controller->reference_max};
    if (!(controller->command_max_v < COMMAND_LIMIT_MAX))
        return TACT_IMAGE_LIMIT;
    if (!is_within(unwinding, 4, COEFFICIENT_MAX) || controller->reference_max < 0.0f)
        return TACT_IMAGE_COEFFICIENT;
    const int32_t refusal = judge_sections(controller->prefilter, controller->prefilter_count, 0);
    return refusal ? refusal : judge_sections(controller->feedback, controller->feedback_count, 1);
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
    for (int32_t c = 0; c < channels; c++) {
        refusal = tact_image_read_channel(&reader, image->names[c], &image->controller[c], &image->strength[c]);
        refusal = refusal ? refusal : judge(&image->controller[c]);
        if (refusal)
            return reader.overrun ? TACT_IMAGE_TRUNCATED : refusal;
    }
    if (reader.overrun || reader.at != size - 4)
        return TACT_IMAGE_TRUNCATED;
    reader = (tact_reader){bytes, size, size - 4, 0};
    image->crc = tact_read_u32(&reader);
    return TACT_IMAGE_GOOD;
}
