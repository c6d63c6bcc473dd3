#include "stm32f405/bus.h"

#include "stm32f405/registers.h"

enum { AHB1_PORTS_ABC = 7, APB1_SPI2 = 1 << 14, BYTE_LOOKS = 1000, LOOPS_PER_US = 60 };
enum { INPUT = 0, OUTPUT = 1, ALTERNATE = 2, FUNCTION_SPI2 = 5, FAST = 2 };
enum { SPI_ON = 1 << 6, SPI_MASTER = 1 << 2, SPI_IDLE_HIGH = 1 << 1, SPI_BY_4 = 1 << 3, SPI_SELECT_SOFT = 3 << 8 };
enum { SPI_RECEIVED = 1, SPI_EMPTY = 2 };

static uint32_t port(tact_pin pin)
{
    return GPIOA + ((uint32_t)pin >> 4) * 0x400u;
}

static uint32_t number(tact_pin pin)
{
    return (uint32_t)pin & 15u;
}

static void two_bits(uint32_t address, uint32_t at, uint32_t value)
{
    tact_set(address, (tact_get(address) & ~(3u << (2u * at))) | value << (2u * at));
}

static void set_up(tact_pin pin, uint32_t mode)
{
    two_bits(port(pin) + GPIO_SPEED, number(pin), FAST);
    two_bits(port(pin) + GPIO_MODE, number(pin), mode);
}

static void set_up_spi_pin(uint32_t at)
{
    const uint32_t address = GPIOB + GPIO_FUNCTION_HIGH, shift = 4u * (at - 8u);
    tact_set(address, (tact_get(address) & ~(15u << shift)) | (uint32_t)FUNCTION_SPI2 << shift);
    set_up((tact_pin)(0x10u | at), ALTERNATE);
}

/* A bootloader has used peripherals, some of them on these pins. */
static void reset_peripherals(void)
{
    static const uint16_t RESETS[] = {0x10, 0x14, 0x18, 0x20, 0x24}; /* AHB1, AHB2, AHB3, APB1, APB2 */
    for (uint32_t i = 0; i < sizeof RESETS / sizeof *RESETS; i++) {
        tact_set(RCC + RESETS[i], 0xFFFFFFFFu);
        tact_set(RCC + RESETS[i], 0);
    }
}

void tact_bus_begin(void)
{
    static const tact_pin HIGH[] = {TACT_PIN_AD_CS, TACT_PIN_DA_LDAC, TACT_PIN_DA_SYNC};
    static const tact_pin LOW[] = {TACT_PIN_AMPLIFIER, TACT_PIN_DA_CLR, TACT_PIN_AD_RESET, TACT_PIN_AD_START};
    reset_peripherals();
    tact_clock_on(RCC_AHB1, AHB1_PORTS_ABC);
    tact_clock_on(RCC_APB1, APB1_SPI2);
    for (uint32_t i = 0; i < sizeof HIGH / sizeof *HIGH; i++)
        tact_bus_raise(HIGH[i]); /* before they are outputs: no pulse */
    for (uint32_t i = 0; i < sizeof LOW / sizeof *LOW; i++)
        tact_bus_lower(LOW[i]);
    for (uint32_t i = 0; i < sizeof HIGH / sizeof *HIGH; i++)
        set_up(HIGH[i], OUTPUT);
    for (uint32_t i = 0; i < sizeof LOW / sizeof *LOW; i++)
        set_up(LOW[i], OUTPUT);
    set_up(TACT_PIN_AD_BUSY, INPUT);
    for (uint32_t at = 13; at <= 15; at++)
        set_up_spi_pin(at);
    tact_set(SPI2 + SPI_CONTROL, SPI_MASTER | SPI_IDLE_HIGH | SPI_BY_4 | SPI_SELECT_SOFT);
    tact_set(SPI2 + SPI_CONTROL, SPI_MASTER | SPI_IDLE_HIGH | SPI_BY_4 | SPI_SELECT_SOFT | SPI_ON);
}

void tact_bus_raise(tact_pin pin)
{
    tact_set(port(pin) + GPIO_SET, 1u << number(pin));
}

void tact_bus_lower(tact_pin pin)
{
    tact_set(port(pin) + GPIO_SET, 1u << (16u + number(pin)));
}

void tact_bus_select(tact_pin pin)
{
    tact_bus_lower(pin);
}

void tact_bus_deselect(tact_pin pin)
{
    tact_bus_raise(pin);
}

int tact_bus_await(tact_pin pin, uint32_t level, uint32_t looks)
{
    while (looks--)
        if ((tact_get(port(pin) + GPIO_IN) >> number(pin) & 1u) == level)
            return 1;
    return 0;
}

static int await_spi(uint32_t flag)
{
    for (uint32_t looks = 0; looks < BYTE_LOOKS; looks++)
        if (tact_get(SPI2 + SPI_STATE) & flag)
            return 1;
    return 0;
}

int tact_bus_exchange(uint8_t *bytes, uint32_t size)
{
    for (uint32_t i = 0; i < size; i++) {
        if (!await_spi(SPI_EMPTY))
            return 0;
        tact_set(SPI2 + SPI_DATA, bytes[i]);
        if (!await_spi(SPI_RECEIVED)) /* all eight bits are through: the chip may be deselected */
            return 0;
        bytes[i] = (uint8_t)(tact_get(SPI2 + SPI_DATA) & 255u);
    }
    return 1;
}

void tact_bus_wait_us(uint32_t duration_us)
{
    for (volatile uint32_t left = duration_us * LOOPS_PER_US; left != 0; left--) {
    }
}

void tact_bus_outputs_safe(void)
{
    tact_set(GPIOA + GPIO_SET, 1u << (16u + (TACT_PIN_AMPLIFIER & 15u)) | 1u << (16u + (TACT_PIN_DA_CLR & 15u)));
}

void tact_bus_outputs_on(void)
{
    tact_set(GPIOA + GPIO_SET, 1u << (TACT_PIN_AMPLIFIER & 15u) | 1u << (TACT_PIN_DA_CLR & 15u));
}
