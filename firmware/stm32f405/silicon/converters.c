/* The converters of a real board: AD7606 in, AD5754R out. A reading that does not come is that of an open sensor. */

#include "stm32f405/silicon/ad5754.h"
#include "stm32f405/silicon/ad7606.h"
#include "stm32f405/bus.h"
#include "stm32f405/chip.h"
#include "cortex_m/interrupts.h"
#include "stm32f405/usart.h"

enum { NO_READING = INT16_MAX, LOOK_EVERY = 64, BARE_SHARE = 16 };

static int32_t channels, missing, bare[TACT_CHANNELS_MAX];
static volatile int32_t is_sound;

int32_t tact_chip_converters(int32_t count)
{
    int32_t codes[TACT_CHANNELS_MAX];
    channels = count;
    tact_ad7606_begin();
    missing = tact_ad7606_read(codes, channels) ? 0 : TACT_MISSING_AD;
    missing |= tact_ad5754_begin() ? 0 : TACT_MISSING_DA;
    is_sound = missing == 0;
    return missing;
}

/* A D/A that was reset by itself, is overloaded or too hot is found within LOOK_EVERY ticks. */
void tact_chip_put_out(const int32_t *codes)
{
    static uint32_t ticks;
    for (int32_t c = 0; c < channels; c++)
        bare[c] = codes[c] / BARE_SHARE;
    if (missing)
        return;
    if (!tact_ad5754_write(codes, channels))
        is_sound = 0;
    if (++ticks % LOOK_EVERY == 0 && !tact_ad5754_is_sound())
        is_sound = 0;
}

void tact_chip_read_in(int32_t *codes)
{
    for (int32_t c = 0; c < channels; c++)
        codes[c] = missing ? bare[c] : NO_READING;
    if (!missing)
        (void)tact_ad7606_read(codes, channels);
}

int tact_chip_is_sound(void)
{
    return is_sound;
}

size_t tact_chip_receive(uint8_t *bytes, size_t most)
{
    const size_t size = tact_usart_receive(bytes, most);
    if (size == 0)
        tact_sleep_unless(tact_usart_has);
    return size;
}
