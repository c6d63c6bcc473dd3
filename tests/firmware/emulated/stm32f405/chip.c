/* STM32F405 of the emulator (QEMU's netduinoplus2): its clock is up already, and the simulated display is in the place of
 * the converters (linked with --wrap=tact_port_begin and --wrap=tact_systick_start). Time stands still while a board that
 * waits for its host, or whose host is behind, has no whole frame: a busy machine does not count against the board, and how
 * fast a host has to be is not what such a run shows. A host that has fed few rows may have no more: it has an eighth of
 * them played for each of its words. */

#include "stm32f405/chip.h"

#include "cortex_m/interrupts.h"
#include "emulated/display.h"
#include "stm32f405/usart.h"

enum { FRAMES_END = 0 };
enum { AN_EIGHTH = 8 };

void __real_tact_port_begin(tact_board *board, tact_link *link);
void __wrap_tact_port_begin(tact_board *board, tact_link *link);
void __real_tact_systick_start(uint32_t clocks, void (*tick)(void));
void __wrap_tact_systick_start(uint32_t clocks, void (*tick)(void));

void __wrap_tact_port_begin(tact_board *board, tact_link *link)
{
    tact_emulated_begin(board, link);
    __real_tact_port_begin(board, link);
}

void __wrap_tact_systick_start(uint32_t clocks, void (*tick)(void))
{
    tact_emulated_ticks(tick, 0);
    __real_tact_systick_start(clocks, tact_emulated_come);
}

int32_t tact_chip_clock(void)
{
    return 0;
}

int32_t tact_chip_converters(int32_t count)
{
    (void)count;
    return 0;
}

void tact_chip_put_out(const int32_t *codes)
{
    tact_emulated_put_out(codes);
}

void tact_chip_read_in(int32_t *codes)
{
    tact_emulated_read_in(codes);
}

uint32_t tact_chip_cycles(void)
{
    return tact_emulated_cycles();
}

int tact_chip_is_sound(void)
{
    return 1;
}

size_t tact_chip_receive(uint8_t *bytes, size_t most)
{
    size_t size = tact_usart_receive(bytes, most);
    if (tact_emulated_holds() || tact_emulated_is_behind(AN_EIGHTH)) {
        while (size < most && (size == 0 || bytes[size - 1] != FRAMES_END)) {
            tact_emulated_stand(); /* a tick that was due may have let it go on */
            tact_sleep_unless(tact_usart_has);
            size += tact_usart_receive(bytes + size, most - size);
        }
        tact_emulated_go_on();
    } else if (size == 0) {
        tact_sleep_unless(tact_usart_has);
    }
    return size;
}
