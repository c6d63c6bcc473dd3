/* An image run over seeded references, tones, saturation and hostile bits; every command goes to standard output. */
#include <stdio.h>
#include <stdlib.h>

#include "arithmetic/noise.h"
#include "board/image.h"

enum { TICKS = 20000 };

static tact_noise dice;

static float any_bits(void)
{
    union {
        uint32_t bits;
        float value;
    } any;
    any.bits = tact_noise_bits(&dice);
    return any.value;
}

/* Quiet noise, noise that saturates, a square wave, and now and then whatever 32 bits may be. */
static float reference_at(int tick)
{
    const float noise = (float)tact_noise_next(&dice) / 65536.0f;
    if (tick % 4000 == 3999)
        return any_bits();
    switch (tick / 2500 % 4) {
    case 0:
        return 3.0f * noise;
    case 1:
        return 900.0f * noise;
    case 2:
        return tick % 80 < 40 ? 300.0f : -300.0f;
    default:
        return 0.0f;
    }
}

int main(int count, char **words)
{
    static uint8_t bytes[TACT_IMAGE_MAX];
    static tact_image image;
    static tact_controller_state state[TACT_CHANNELS_MAX];
    float position[TACT_CHANNELS_MAX] = {0.0f};
    FILE *file = count == 2 ? fopen(words[1], "rb") : NULL;
    if (file == NULL)
        return 2;
    const size_t size = fread(bytes, 1, sizeof bytes, file);
    fclose(file);
    if (tact_image_parse(&image, bytes, size, 4000.0f, 1, 3) != TACT_IMAGE_GOOD)
        return 1;
    tact_noise_seed(&dice, 12u, 7u);
    for (int k = 0; k < image.channels; k++)
        tact_controller_reset(&image.controller[k], &state[k]);
    for (int tick = 0; tick < TICKS; tick++)
        for (int k = 0; k < image.channels; k++) {
            const float reference = tact_finite(reference_at(tick), TACT_REFERENCE_MAX);
            const float command = tact_controller_step(&image.controller[k], &state[k], reference, position[k]);
            position[k] = 0.99f * position[k] + 0.004f * command;
            if (fwrite(&command, sizeof command, 1, stdout) != 1)
                return 3;
        }
    return 0;
}
