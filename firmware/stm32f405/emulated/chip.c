/* STM32F405 of the emulator (QEMU's netduinoplus2): its clock is up already, and the simulated display is in the place of
 * the converters. Time stands still while a board that waits for its host, or whose host is behind, hears nothing: a busy
 * machine does not count against the board, and how fast a host has to be is not what such a run shows. */

#include "stm32f405/chip.h"

#include "cortex_m/systick.h"
#include "emulated/bench.h"
#include "emulated/display.h"
#include "stm32f405/usart.h"

enum { SUPERVISED = 8 }; /* interrupts after the last byte, so that the supervisor has seen what it brought */

int tact_chip_clock(void)
{
    return 1;
}

int tact_chip_converters(tact_board *board, tact_link *link)
{
    tact_emulated_begin(board, link);
    tact_emulated_bench_begin(board);
    link->bench = tact_emulated_bench;
    return 1;
}

void tact_chip_put_out(const int32_t *codes)
{
    tact_emulated_put_out(codes);
}

void tact_chip_read_in(int32_t *codes)
{
    tact_emulated_read_in(codes);
}

void tact_chip_finish(void)
{
    tact_emulated_finish();
}

int tact_chip_holds(void)
{
    return tact_emulated_holds();
}

int tact_chip_is_sound(void)
{
    return 1;
}

void tact_chip_idle(int something_came)
{
    static uint32_t looks;
    const int waits = tact_emulated_holds() && looks > SUPERVISED;
    looks = something_came ? 0 : looks + 1;
    if (something_came)
        return;
    if (waits || tact_emulated_is_behind()) {
        tact_systick_stand();
        tact_sleep_unless(tact_usart_has);
        tact_systick_go_on();
    } else {
        tact_sleep_unless(tact_usart_has);
    }
}
