#include "board/safety.h"

#include "board/sealed.h"
#include "wire/bytes.h"

enum { TICKS_MAX = TACT_SAFETY_NEVER };

/* A float32 within [low, high]; anything else marks the reader. */
static float number(tact_reader *reader, int *bad, float low, float high)
{
    const float value = tact_read_f32(reader);
    if (!(tact_is_number(value) && value >= low && value <= high))
        *bad = 1;
    return *bad ? 0.0f : value;
}

static int32_t integer(tact_reader *reader, int *bad, int32_t low, int32_t high)
{
    const int32_t value = tact_read_i32(reader);
    if (value < low || value > high)
        *bad = 1;
    return *bad ? low : value;
}

static void read_converter(tact_reader *reader, tact_safety_channel *channel, int *bad)
{
    const int32_t bits = integer(reader, bad, 8, 24);
    const int32_t polarity = integer(reader, bad, -1, 1);
    const float range_v = number(reader, bad, 1e-3f, 31.0f);
    const float offset_v = number(reader, bad, -31.0f, 31.0f);
    if (polarity == 0)
        *bad = 1;
    if (!*bad)
        tact_converter_make(&channel->converter, bits, (double)range_v, (double)polarity, (double)offset_v);
}

/* The command's limit, drawn in to where the D/A still follows: float32 tells the last codes of more than 20 bits no more
 * apart, and one too many would come out with its sign turned. */
static void draw_in(tact_safety_channel *channel)
{
    const tact_converter *converter = &channel->converter;
    const float most = (float)(converter->code_max - (converter->code_max >> 19));
    const float reach_v = most * converter->step_v_single - __builtin_fabsf(converter->offset_v_single);
    channel->command_max_v = channel->command_max_v < reach_v ? channel->command_max_v : reach_v;
}

static void read_channel(tact_reader *reader, tact_safety_channel *channel, int *bad)
{
    read_converter(reader, channel, bad);
    channel->position_code_max = integer(reader, bad, 1, 1 << 24);
    channel->frozen_ticks = integer(reader, bad, 1, TICKS_MAX);
    channel->stop_max_v = number(reader, bad, 0.0f, 1e6f);
    channel->stop_lead = number(reader, bad, 0.0f, 1e6f);
    channel->command_max_v = number(reader, bad, 0.0f, 31.0f);
    if (!*bad)
        draw_in(channel);
    channel->reference_max = number(reader, bad, 0.0f, 1e5f);
    channel->comfort_max = number(reader, bad, 0.0f, 1e5f);
    channel->disagreement_v = number(reader, bad, 0.0f, 1e6f);
    channel->reversal_power = number(reader, bad, 0.0f, 1e6f);
    channel->drive = number(reader, bad, -1e3f, 1e3f);
    channel->damp = number(reader, bad, -1.0f, 1.0f);
    channel->spring = number(reader, bad, -1.0f, 1.0f);
    channel->correct_x = number(reader, bad, -2.0f, 2.0f);
    channel->correct_w = number(reader, bad, -2.0f, 2.0f);
    channel->still_codes = integer(reader, bad, 0, 1 << 24);
    channel->stray_max_v = number(reader, bad, 0.0f, 1e6f);
    channel->jump_v = number(reader, bad, 0.0f, 1e6f);
    channel->jump_share = number(reader, bad, 0.0f, 1e3f);
    channel->travel_max = number(reader, bad, 0.0f, 1e5f);
    for (int32_t i = 0; i < TACT_WEIGHTING_COUNT; i++) {
        tact_section *section = &channel->weighting[i];
        section->b0 = number(reader, bad, -1e8f, 1e8f);
        section->b1 = number(reader, bad, -1e8f, 1e8f);
        section->b2 = number(reader, bad, -1e8f, 1e8f);
        section->a1 = number(reader, bad, 0.0f, 4.0f);
        section->a2 = number(reader, bad, 0.0f, 4.0f);
    }
}

int32_t tact_safety_parse(tact_safety *table, const uint8_t *bytes, size_t size, int32_t channels_max)
{
    const tact_sealed_kind kind = {TACT_SAFETY_MAGIC, TACT_SAFETY_VERSION, TACT_SAFETY_MAX};
    const int32_t refusal = tact_sealed_check(&kind, bytes, size);
    int bad = 0;
    if (refusal)
        return refusal;
    tact_reader reader = {bytes, size - 4, 6, 0};
    table->channels = tact_read_u8(&reader);
    table->delay_samples = tact_read_u8(&reader);
    (void)tact_read_u32(&reader);
    if (table->channels < 1 || table->channels > channels_max || table->channels > TACT_CHANNELS_MAX)
        return TACT_SAFETY_CHANNELS;
    if (table->delay_samples < 1 || table->delay_samples > 8)
        return TACT_SAFETY_NUMBER;
    table->rate_hz = number(&reader, &bad, 1.0f, 1e6f);
    table->lateness_max = integer(&reader, &bad, 1, 255);
    table->silence_ticks = integer(&reader, &bad, 1, TICKS_MAX);
    table->soft_start_ticks = integer(&reader, &bad, 1, TICKS_MAX);
    table->fade_ticks = integer(&reader, &bad, 1, TICKS_MAX);
    table->ramp_ticks = integer(&reader, &bad, 1, TICKS_MAX);
    table->quick_ticks = integer(&reader, &bad, 1, TICKS_MAX);
    table->turns = integer(&reader, &bad, 1, 64);
    table->travel_share = number(&reader, &bad, 1e-6f, 1.0f);
    table->lock_ticks = integer(&reader, &bad, 0, TICKS_MAX);
    table->lock_faults = integer(&reader, &bad, 1, TICKS_MAX);
    for (int32_t c = 0; c < table->channels; c++)
        read_channel(&reader, &table->channel[c], &bad);
    if (reader.overrun || reader.at != size - 4)
        return TACT_SAFETY_TRUNCATED;
    reader = (tact_reader){bytes, size, size - 4, 0};
    table->crc = tact_read_u32(&reader);
    return bad ? TACT_SAFETY_NUMBER : TACT_SAFETY_GOOD;
}
