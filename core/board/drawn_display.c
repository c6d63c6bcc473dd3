#include "board/drawn_display.h"

#include "board/drawn_table.h"

static void let_go(tact_drawn_channel *channel)
{
    channel->force_v = 0.0f;
    channel->mobility = 1.0f;
    channel->lie = TACT_LIE_NONE;
    channel->amount = 0;
}

void tact_drawn_rest(tact_drawn_display *display)
{
    for (int32_t c = 0; c < TACT_CHANNELS_MAX; c++) {
        tact_drawn_channel *channel = &display->channel[c];
        channel->x = channel->w = channel->before_v = 0.0f;
        channel->code = 0;
        let_go(channel);
    }
}

void tact_drawn_event(tact_drawn_display *display, const tact_safety *safety, tact_noise *noise)
{
    tact_drawn_channel *channel = &display->channel[tact_drawn_of(noise, (uint32_t)safety->channels)];
    const uint32_t kind = tact_drawn_of(noise, 8);
    if (kind < 3) {
        let_go(channel);
    } else if (kind < 5) {
        channel->force_v = 4.0f * (tact_drawn_share(noise) - 0.5f);
    } else if (kind == 5) {
        channel->mobility = 0.5f + 0.5f * tact_drawn_share(noise);
    } else {
        channel->lie = (int32_t)tact_drawn_of(noise, TACT_LIE_LAST + 1);
        channel->amount = (int32_t)(tact_noise_bits(noise) >> 20) - 2048;
    }
}

static int32_t told(tact_drawn_channel *channel, const tact_converter *converter, int32_t code, tact_noise *noise)
{
    const int32_t before = channel->code;
    switch (channel->lie) {
    case TACT_LIE_OPEN:
        return converter->code_max;
    case TACT_LIE_ZERO:
        return 0;
    case TACT_LIE_FROZEN:
        return before;
    case TACT_LIE_REVERSED:
        return -code;
    case TACT_LIE_STUCK:
        return channel->amount + (int32_t)tact_drawn_of(noise, 5) - 2;
    case TACT_LIE_OFFSET:
        return code + channel->amount;
    case TACT_LIE_DRIFT:
        channel->amount += channel->amount < 0 ? -1 : 1;
        return code + channel->amount;
    case TACT_LIE_ANYTHING:
        return (int32_t)tact_noise_bits(noise) >> 16;
    default:
        return code;
    }
}

/* One tick on, under the command that is out now. */
static void move(tact_drawn_channel *channel, const tact_safety_channel *safety, float motor_v)
{
    const float pushed_v = motor_v + channel->before_v + 2.0f * channel->force_v;
    channel->before_v = motor_v;
    channel->w = (1.0f - safety->damp) * channel->w +
                 (channel->mobility * safety->drive * pushed_v - safety->spring * channel->x);
    channel->x = channel->x + channel->w;
    if (!(channel->x < 32.0f && channel->x > -32.0f)) /* an end stop */
        channel->x = channel->w = 0.0f;
}

void tact_drawn_codes(tact_drawn_display *display, const tact_safety *safety, const int32_t *out, int32_t *in,
                      tact_noise *noise)
{
    for (int32_t c = 0; c < safety->channels; c++) {
        tact_drawn_channel *channel = &display->channel[c];
        const tact_converter *converter = &safety->channel[c].converter;
        const int32_t jitter = (int32_t)tact_drawn_of(noise, 5) - 2;
        const int32_t clean = (int32_t)(channel->x / converter->step_v_single) + jitter;
        const int32_t code = told(channel, converter, clean, noise);
        const int32_t most = converter->code_max;
        in[c] = channel->code = code > most ? most : code < -most ? -most : code;
        move(channel, &safety->channel[c], (float)out[c] * converter->motor_step_v_single + converter->offset_v_single);
    }
}
