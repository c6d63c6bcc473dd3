/* STM32F405 at 168 MHz: SysTick, USART3 (usart.h), converters on SPI2 (bus.h), amplifier enable, watchdog. Boards one can
 * buy: Adafruit's Feather STM32F405, Olimex' STM32-H405; docs/porting.md has the pins. */

#include "stm32f405/bus.h"
#include "stm32f405/chip.h"
#include "port.h"
#include "cortex_m/startup.h"
#include "cortex_m/interrupts.h"
#include "cortex_m/systick.h"
#include "stm32f405/usart.h"
#include "stm32f405/watchdog.h"

enum { CLOCK_HZ = 168000000 };

static volatile int32_t watchdog_runs;
static int32_t missing;

static int32_t missing_now(void)
{
    return missing | (tact_supply_is_low() ? TACT_MISSING_SUPPLY : 0);
}

void tact_port_begin(tact_board *board, tact_link *link)
{
    tact_bus_begin();
    missing = tact_chip_clock();
    if (missing == TACT_NO_CLOCK)
        tact_halt(); /* outputs safe for good; it cannot be reported */
    tact_supply_watch();
    tact_usart_begin();
    missing |= tact_chip_converters(board->channels_max);
    link->missing = missing_now;
}

void tact_port_start_timer(float rate_hz, void (*tick)(void))
{
    watchdog_runs = watchdog_runs || tact_watchdog_start();
    if (!watchdog_runs)
        missing |= TACT_MISSING_WATCHDOG;
    tact_systick_start((uint32_t)((float)CLOCK_HZ / rate_hz + 0.5f), tick);
}

void tact_port_put_out(const int32_t *codes)
{
    tact_chip_put_out(codes);
}

void tact_port_read_in(int32_t *codes)
{
    tact_chip_read_in(codes);
}

uint32_t tact_port_lateness(void)
{
    return tact_systick_lateness();
}

size_t tact_port_receive(uint8_t *bytes, size_t most)
{
    return tact_chip_receive(bytes, most);
}

void tact_port_send(const uint8_t *bytes, size_t size)
{
    tact_usart_send(bytes, size);
}

uint32_t tact_port_enter(void)
{
    return tact_interrupts_enter();
}

void tact_port_leave(uint32_t before)
{
    tact_interrupts_leave(before);
}

void tact_port_outputs_safe(void)
{
    tact_bus_outputs_safe();
}

void tact_port_outputs_on(void)
{
    if (watchdog_runs)
        tact_bus_outputs_on();
}

void tact_port_feed_watchdog(void)
{
    tact_watchdog_feed();
}

uint32_t tact_port_cycles(void)
{
    return tact_chip_cycles();
}

int tact_port_is_sound(void)
{
    return tact_chip_is_sound();
}
