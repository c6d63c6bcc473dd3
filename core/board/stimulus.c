#include "board/stimulus.h"

#include "wire/bytes.h"

static void rotate(float *cosine, float *sine, float by_cosine, float by_sine)
{
    const float c = *cosine * by_cosine - *sine * by_sine;
    const float s = *sine * by_cosine + *cosine * by_sine;
    const float length = 1.5f - 0.5f * (c * c + s * s);
    *cosine = c * length;
    *sine = s * length;
}

static int is_rotation(float cosine, float sine)
{
    const float excess = cosine * cosine + sine * sine - 1.0f;
    return excess < 1e-4f && excess > -1e-4f; /* false for NaN */
}

int tact_tone_is_valid(const tact_tone *tone)
{
    return tone->length <= 0x7fffffffu && tone->start <= 0x7fffffffu && tone->ramp <= tone->length / 2 &&
           tact_is_number(tone->amplitude) && is_rotation(tone->cosine, tone->sine) &&
           is_rotation(tone->ramp_cosine, tone->ramp_sine);
}

void tact_stimulus_rewind(tact_stimulus *stimulus)
{
    for (int i = 0; i < TACT_TONES_MAX; i++) {
        const tact_tone_state rest = {1.0f, 0.0f, 1.0f, 0.0f};
        stimulus->state[i] = rest;
    }
}

static float tone_next(const tact_tone *tone, tact_tone_state *state, uint32_t at)
{
    const int ramps = at < tone->ramp || at >= tone->length - tone->ramp;
    const float envelope = ramps ? 0.5f * (1.0f - state->ramp_cosine) : 1.0f;
    const float value = tone->amplitude * envelope * state->sine;
    rotate(&state->cosine, &state->sine, tone->cosine, tone->sine);
    if (ramps)
        rotate(&state->ramp_cosine, &state->ramp_sine, tone->ramp_cosine, tone->ramp_sine);
    return value;
}

float tact_stimulus_next(tact_stimulus *stimulus, uint32_t tick)
{
    float sum = 0.0f;
    for (int32_t i = 0; i < stimulus->count; i++) {
        const tact_tone *tone = &stimulus->tone[i];
        if (tick >= tone->start && tick - tone->start < tone->length)
            sum += tone_next(tone, &stimulus->state[i], tick - tone->start);
    }
    return sum;
}
