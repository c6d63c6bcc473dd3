#include "board/drawn_table.h"

enum { FEW_TICKS = 96, CALM = 2 }; /* one table and one image in CALM is altered throughout */

float tact_drawn_share(tact_noise *noise)
{
    return (float)(tact_noise_bits(noise) >> 8) * (1.0f / 16777216.0f);
}

uint32_t tact_drawn_of(tact_noise *noise, uint32_t count)
{
    return (tact_noise_bits(noise) >> 8) % count;
}

/* A time of the table, or a short one. */
static int32_t ticks(int32_t of, tact_noise *noise)
{
    const int32_t few = 1 + (int32_t)tact_drawn_of(noise, FEW_TICKS);
    return tact_drawn_of(noise, 4) == 0 || of < few ? of : few;
}

/* A limit of the table, one that is soon passed, or one that is not. */
static float limit(float of, float most, tact_noise *noise)
{
    const uint32_t kind = tact_drawn_of(noise, 6);
    const float share = tact_drawn_share(noise);
    return kind < 3 ? of : kind == 3 ? of * share : kind == 4 ? of * share * share * share : most;
}

static void draw_converter(tact_converter *converter, tact_noise *noise)
{
    const uint32_t kind = tact_drawn_of(noise, 8);
    const int32_t bits = 12 + (int32_t)tact_drawn_of(noise, 13);
    const float offset_v = tact_drawn_share(noise) - 0.5f;
    const double range_v = converter->step_v * -(double)converter->code_min;
    if (kind < 5)
        return;
    tact_converter_make(converter, kind == 5 ? 16 : bits, range_v, kind == 6 ? 1.0 : -1.0, (double)offset_v);
}

static void draw_channel(tact_safety_channel *channel, tact_noise *noise)
{
    draw_converter(&channel->converter, noise);
    if (channel->position_code_max >= channel->converter.code_max)
        channel->position_code_max = channel->converter.code_max - 1;
    channel->stop_max_v = limit(channel->stop_max_v, 1e6f, noise);
    channel->command_max_v = limit(channel->command_max_v, 31.0f, noise);
    channel->reference_max = limit(channel->reference_max, 1e5f, noise);
    channel->comfort_max = limit(channel->comfort_max, 1e5f, noise);
    channel->disagreement_v = limit(channel->disagreement_v, 1e6f, noise);
    channel->still_codes = (int32_t)tact_drawn_of(noise, 24);
    channel->stray_max_v = limit(channel->stray_max_v, 1e6f, noise);
    channel->jump_v = limit(channel->jump_v, 1e6f, noise);
    channel->travel_max = limit(channel->travel_max, 1e5f, noise);
    channel->reversal_power = limit(channel->reversal_power, 1e6f, noise);
}

void tact_drawn_safety(tact_safety *safety, const tact_safety *from, tact_noise *noise)
{
    *safety = *from;
    safety->lateness_max = 1 + (int32_t)tact_drawn_of(noise, 255);
    safety->silence_ticks = ticks(safety->silence_ticks, noise);
    safety->soft_start_ticks = ticks(safety->soft_start_ticks, noise);
    safety->fade_ticks = ticks(safety->fade_ticks, noise);
    safety->ramp_ticks = ticks(safety->ramp_ticks, noise);
    safety->quick_ticks = ticks(safety->quick_ticks, noise);
    safety->lock_ticks = (int32_t)tact_drawn_of(noise, FEW_TICKS);
    for (int32_t c = 0; c < safety->channels; c++)
        safety->channel[c].frozen_ticks = ticks(safety->channel[c].frozen_ticks, noise);
    if (tact_drawn_of(noise, CALM) != 0) { /* the limits that were designed: what is usual goes on for a while */
        safety->turns = 1 + (int32_t)tact_drawn_of(noise, 4);
        return;
    }
    if (tact_drawn_of(noise, 2)) {
        safety->delay_samples = 1 + (int32_t)tact_drawn_of(noise, 8);
        safety->turns = 1 + (int32_t)tact_drawn_of(noise, 4);
    }
    for (int32_t c = 0; c < safety->channels; c++)
        draw_channel(&safety->channel[c], noise);
}

static void draw_controller(tact_controller *table, uint32_t kind, float share)
{
    tact_section *first = table->feedback_count ? &table->feedback[0] : &table->prefilter[0];
    if (kind == 1) { /* stronger or weaker, and of the wrong sign at times */
        const float gain = 8.0f * (share - 0.25f);
        first->b0 *= gain;
        first->b1 *= gain;
        first->b2 *= gain;
    } else if (kind == 2) {
        table->feedback_count = 0;
    } else if (kind == 3) {
        table->prefilter_count = 1;
    } else if (kind == 4 && table->feedback_count) { /* another form, the same controller but for rounding */
        tact_section *last = &table->feedback[table->feedback_count - 1];
        last->b0 *= 2.0f;
        last->b1 *= 2.0f;
        last->b2 *= 2.0f;
    }
}

/* Another delay than the display's, with which a finger is not fed in one piece. */
static void draw_touch(tact_touch *touch, tact_noise *noise)
{
    touch->delay = 1 + (int32_t)tact_drawn_of(noise, TACT_TOUCH_DELAY_MAX);
}

void tact_drawn_image(tact_image *image, const tact_image *from, tact_noise *noise)
{
    *image = *from;
    if (tact_drawn_of(noise, CALM) != 0)
        return;
    for (int32_t c = 0; c < image->channels; c++) {
        const uint32_t kind = tact_drawn_of(noise, 10);
        const float share = tact_drawn_share(noise);
        if (kind > 5 && image->controller[c].touch.delay)
            draw_touch(&image->controller[c].touch, noise);
        draw_controller(&image->controller[c], kind, share);
    }
}
