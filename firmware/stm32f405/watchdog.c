#include "stm32f405/watchdog.h"

#include "stm32f405/bus.h"
#include "stm32f405/registers.h"

#define EXTI 0x40013C00u
#define NVIC_UNPEND 0xE000E280u

enum { KEY_FEED = 0xAAAA, KEY_OPEN = 0x5555, KEY_START = 0xCCCC, BY_4 = 0, COUNTS = 76, TAKES_OVER = 3 };
enum { LOOKS = 100000 }; /* five clocks of the slowest oscillator are 300 us, some 5,000 looks */
enum { EXTI_MASK = 0x00, EXTI_RISING = 0x08, EXTI_PENDING = 0x14, SUPPLY_LINE = 1 << 16, SUPPLY_FALLS = 1, APB1_PWR = 1 << 28 };
enum { PWR_WATCHES = 1 << 4, PWR_BELOW_2_9_V = 7 << 5, PWR_IS_LOW = 1 << 2, DETECTOR_US = 100 };

int tact_watchdog_start(void)
{
    uint32_t looks = LOOKS;
    tact_set(IWDG + IWDG_KEY, KEY_START);
    tact_set(IWDG + IWDG_KEY, KEY_OPEN);
    tact_set(IWDG + IWDG_PRESCALER, BY_4);
    tact_set(IWDG + IWDG_RELOAD, COUNTS - 1);
    while (tact_get(IWDG + IWDG_STATE) & TAKES_OVER && looks)
        looks--;
    tact_set(IWDG + IWDG_KEY, KEY_FEED);
    return looks != 0;
}

void tact_watchdog_feed(void)
{
    tact_set(IWDG + IWDG_KEY, KEY_FEED);
}

void tact_supply_watch(void)
{
    tact_clock_on(RCC_APB1, APB1_PWR);
    tact_set(PWR + PWR_CONTROL, tact_get(PWR + PWR_CONTROL) | PWR_BELOW_2_9_V);
    tact_set(PWR + PWR_CONTROL, tact_get(PWR + PWR_CONTROL) | PWR_WATCHES);
    tact_bus_wait_us(DETECTOR_US);
    tact_set(EXTI + EXTI_RISING, tact_get(EXTI + EXTI_RISING) | SUPPLY_LINE);
    tact_set(EXTI + EXTI_PENDING, SUPPLY_LINE); /* that it was low when the detector began is no fall */
    tact_set(NVIC_UNPEND, 1u << SUPPLY_FALLS);
    tact_set(EXTI + EXTI_MASK, tact_get(EXTI + EXTI_MASK) | SUPPLY_LINE);
    tact_set(NVIC_ENABLE, 1u << SUPPLY_FALLS);
}

int tact_supply_is_low(void)
{
    return (tact_get(PWR + PWR_STATE) & PWR_IS_LOW) != 0;
}
