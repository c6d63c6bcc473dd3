#include "stm32f405/watchdog.h"

#include "stm32f405/registers.h"

#define EXTI 0x40013C00u

enum { KEY_FEED = 0xAAAA, KEY_OPEN = 0x5555, KEY_START = 0xCCCC, BY_4 = 0, COUNTS = 76 };
enum { EXTI_MASK = 0x00, EXTI_RISING = 0x08, SUPPLY_LINE = 1 << 16, SUPPLY_FALLS = 1, APB1_PWR = 1 << 28 };
enum { PWR_CONTROL = 0x00, PWR_WATCHES = 1 << 4, PWR_BELOW_2_9_V = 7 << 5 };

void tact_watchdog_start(void)
{
    tact_set(IWDG + IWDG_KEY, KEY_START);
    tact_set(IWDG + IWDG_KEY, KEY_OPEN);
    tact_set(IWDG + IWDG_PRESCALER, BY_4);
    tact_set(IWDG + IWDG_RELOAD, COUNTS - 1);
    tact_set(IWDG + IWDG_KEY, KEY_FEED);
}

void tact_watchdog_feed(void)
{
    tact_set(IWDG + IWDG_KEY, KEY_FEED);
}

void tact_supply_watch(void)
{
    tact_set(RCC + RCC_APB1, tact_get(RCC + RCC_APB1) | APB1_PWR);
    tact_set(PWR + PWR_CONTROL, tact_get(PWR + PWR_CONTROL) | PWR_BELOW_2_9_V);
    tact_set(PWR + PWR_CONTROL, tact_get(PWR + PWR_CONTROL) | PWR_WATCHES);
    tact_set(EXTI + EXTI_RISING, tact_get(EXTI + EXTI_RISING) | SUPPLY_LINE);
    tact_set(EXTI + EXTI_MASK, tact_get(EXTI + EXTI_MASK) | SUPPLY_LINE);
    tact_set(NVIC_ENABLE, 1u << SUPPLY_FALLS);
}
