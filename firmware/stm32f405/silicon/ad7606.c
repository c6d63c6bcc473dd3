#include "stm32f405/silicon/ad7606.h"

#include "stm32f405/bus.h"

enum { BEGINS_LOOKS = 100, ENDS_LOOKS = 2000, RESET_US = 1 };

void tact_ad7606_begin(void)
{
    tact_bus_lower(TACT_PIN_AD_START);
    tact_bus_raise(TACT_PIN_AD_RESET);
    tact_bus_wait_us(RESET_US);
    tact_bus_lower(TACT_PIN_AD_RESET);
    tact_bus_wait_us(RESET_US);
}

static int convert(void)
{
    tact_bus_raise(TACT_PIN_AD_START);
    const int begins = tact_bus_await(TACT_PIN_AD_BUSY, 1, BEGINS_LOOKS);
    const int ends = begins && tact_bus_await(TACT_PIN_AD_BUSY, 0, ENDS_LOOKS);
    tact_bus_lower(TACT_PIN_AD_START);
    return ends;
}

int tact_ad7606_read(int32_t *codes, int32_t channels)
{
    uint8_t bytes[2 * TACT_AD7606_CHANNELS] = {0};
    if (!convert())
        return 0;
    tact_bus_select(TACT_PIN_AD_CS);
    const int good = tact_bus_exchange(bytes, 2u * (uint32_t)channels);
    tact_bus_deselect(TACT_PIN_AD_CS);
    for (int32_t c = 0; good && c < channels; c++)
        codes[c] = (int16_t)(uint16_t)(bytes[2 * c] << 8 | bytes[2 * c + 1]);
    return good;
}
