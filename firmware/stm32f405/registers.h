/* STM32F405: the registers that this board's program touches (reference manual RM0090, Armv7-M reference manual).
 *
 * Example use:
 *   tact_set(GPIOB + GPIO_SET, 1u << 8);
 */
#ifndef TACT_STM32F405_REGISTERS_H
#define TACT_STM32F405_REGISTERS_H

#include "cortex_m/registers.h"

#define GPIOA 0x40020000u
#define GPIOB 0x40020400u
#define GPIOC 0x40020800u
#define SPI2 0x40003800u
#define USART3 0x40004800u
#define RCC 0x40023800u
#define FLASH 0x40023C00u
#define PWR 0x40007000u
#define IWDG 0x40003000u
#define NVIC_ENABLE 0xE000E100u
#define DWT 0xE0001000u
#define DEBUG_TRACE 0xE000EDFCu /* DEMCR */

enum { GPIO_MODE = 0x00, GPIO_SPEED = 0x08, GPIO_PULL = 0x0C, GPIO_IN = 0x10, GPIO_SET = 0x18, GPIO_FUNCTION_LOW = 0x20 };
enum { GPIO_FUNCTION_HIGH = 0x24 };
enum { SPI_CONTROL = 0x00, SPI_STATE = 0x08, SPI_DATA = 0x0C };
enum { USART_STATE = 0x00, USART_DATA = 0x04, USART_RATE = 0x08, USART_CONTROL = 0x0C };
enum { RCC_CONTROL = 0x00, RCC_PLL = 0x04, RCC_CONFIGURE = 0x08, RCC_AHB1 = 0x30, RCC_APB1 = 0x40 };
enum { IWDG_KEY = 0x00, IWDG_PRESCALER = 0x04, IWDG_RELOAD = 0x08, IWDG_STATE = 0x0C };
enum { PWR_CONTROL = 0x00, PWR_STATE = 0x04 };
enum { DWT_CONTROL = 0x00, DWT_CYCLES = 0x04 };

/* A peripheral's clock on. It takes two of its clocks (errata ES0182, 2.1.13): what is written to the peripheral before is
 * lost, so the register is read back. */
static inline void tact_clock_on(uint32_t bus, uint32_t which)
{
    tact_set(RCC + bus, tact_get(RCC + bus) | which);
    (void)tact_get(RCC + bus);
}

#endif
