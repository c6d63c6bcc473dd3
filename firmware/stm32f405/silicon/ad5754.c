#include "stm32f405/silicon/ad5754.h"

#include "stm32f405/bus.h"

enum { READ = 0x80, CODES = 0, RANGE = 1, POWER = 2, CONTROL = 3, ALL = 4, SETTINGS = 1 };
enum { PLUS_MINUS_10_V = 4, POWERED = 0x1F, CLAMPED_AND_HOT_STOPS = 0x0C, ALERTS = 0x07A0, POWER_UP_US = 20 };

static int exchange(uint8_t head, uint16_t data, uint16_t *answer)
{
    uint8_t bytes[3] = {head, (uint8_t)(data >> 8), (uint8_t)(data & 255u)};
    tact_bus_select(TACT_PIN_DA_SYNC);
    const int good = tact_bus_exchange(bytes, sizeof bytes);
    tact_bus_deselect(TACT_PIN_DA_SYNC);
    if (answer)
        *answer = (uint16_t)(bytes[1] << 8 | bytes[2]);
    return good;
}

static int put(int32_t kind, int32_t address, uint16_t data)
{
    return exchange((uint8_t)(kind << 3 | address), data, 0);
}

static int get(int32_t kind, int32_t address, uint16_t *data)
{
    return exchange((uint8_t)(READ | kind << 3 | address), 0, 0) && exchange(CONTROL << 3, 0, data);
}

int tact_ad5754_begin(void)
{
    tact_bus_raise(TACT_PIN_DA_LDAC);
    if (!put(RANGE, ALL, PLUS_MINUS_10_V) || !put(CONTROL, SETTINGS, CLAMPED_AND_HOT_STOPS) ||
        !put(CODES, ALL, 0) || !put(POWER, 0, POWERED))
        return 0;
    tact_bus_wait_us(POWER_UP_US);
    return tact_ad5754_is_sound();
}

int tact_ad5754_write(const int32_t *codes, int32_t channels)
{
    int good = 1;
    for (int32_t c = 0; c < channels && c < TACT_AD5754_CHANNELS; c++)
        good &= put(CODES, c, (uint16_t)((uint32_t)codes[c] & 0xffffu));
    tact_bus_lower(TACT_PIN_DA_LDAC);
    tact_bus_raise(TACT_PIN_DA_LDAC);
    return good;
}

int tact_ad5754_is_sound(void)
{
    uint16_t range = 0, power = 0;
    if (!get(RANGE, 0, &range) || !get(POWER, 0, &power))
        return 0;
    return (range & 7u) == PLUS_MINUS_10_V && (power & POWERED) == POWERED && (power & ALERTS) == 0;
}
