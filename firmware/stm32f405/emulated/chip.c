/* STM32F405 of the emulator (QEMU's netduinoplus2): its clock is up already, and the simulated display is in the place of
 * the converters. Time stands still while a board that waits for its host, or whose host is behind, has no whole frame: a
 * busy machine does not count against the board, and how fast a host has to be is not what such a run shows. A host that
 * has fed few rows may have no more: it has an eighth of them played for each of its words. */

#include "stm32f405/chip.h"

#include "cortex_m/interrupts.h"
#include "cortex_m/systick.h"
#include "emulated/bench.h"
#include "emulated/display.h"
#include "stm32f405/usart.h"

enum { FRAMES_END = 0 };
enum { SUPERVISED = 8 }; /* interrupts after the last byte, so that the supervisor has seen what it brought */
enum { AN_EIGHTH = 8 };

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

size_t tact_chip_receive(uint8_t *bytes, size_t most)
{
    static uint32_t looks;
    size_t size = tact_usart_receive(bytes, most);
    if ((tact_emulated_holds() && looks > SUPERVISED) || tact_emulated_is_behind(AN_EIGHTH)) {
        while (size < most && (size == 0 || bytes[size - 1] != FRAMES_END)) {
            tact_systick_stand(); /* a tick that was due may have let it go on */
            tact_sleep_unless(tact_usart_has);
            size += tact_usart_receive(bytes + size, most - size);
        }
        tact_systick_go_on();
    } else if (size == 0) {
        tact_sleep_unless(tact_usart_has);
    }
    looks = size ? 0 : looks + 1;
    return size;
}
