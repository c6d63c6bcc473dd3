/* MPS2 under QEMU (AN386: Cortex-M4F, AN500: Cortex-M7): SysTick, FIFOs of the host or UART 0, and the simulated
 * display in the place of converters. Between runs the display's time stands still, so that what a board plays does
 * not depend on how long the host takes.
 *
 * Over FIFOs a read waits for the host, and no time passes on the board but in leaps from one interrupt of the timer to
 * the next, before it waits: as many as pass on a board in the host's own process.
 *
 * Over the UART time goes on, as on a real board: the main loop looks for bytes while the interrupt comes and goes. The
 * timer stands still while the display is computed, which no real board does. Where the emulator's time follows the
 * instructions, a sleep until the next interrupt (WFI) would leap there at once, so a free run only dozes: WFE is one
 * instruction of the board and leaves the machine to the host meanwhile. Where the host is behind, time waits for it. */

#include "cortex_m/interrupts.h"
#include "cortex_m/systick.h"
#include "emulated/display.h"
#include "emulated/mps2/semihosting.h"
#include "port.h"

enum { CLOCK_HZ = 25000000 };
enum { PATIENCE = 4096 }; /* looks at a silent UART before sleep */
enum { AN_EIGHTH = 8, DOZES = 2000, DOZES_WITH_ROWS = 20000 }; /* some milliseconds of the host's */
enum { WATCHDOG_CLOCKS = CLOCK_HZ / 100 };

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define UART_DATA REGISTER(0x40004000u)
#define UART_STATE REGISTER(0x40004004u)
#define UART_CONTROL REGISTER(0x40004008u)
#define UART_DIVISOR REGISTER(0x40004010u)
#define WATCHDOG_LOAD REGISTER(0x40008000u)
#define WATCHDOG_LEFT REGISTER(0x40008004u)
#define WATCHDOG_CONTROL REGISTER(0x40008008u)
#define WATCHDOG_CLEAR REGISTER(0x4000800Cu)
#define WATCHDOG_LOCK REGISTER(0x40008C00u)
#define LEDS REGISTER(0x40028000u)
enum { UART_FULL = 1, UART_HAS = 2, UART_BOTH = 3 };
enum { WATCHDOG_INTERRUPTS = 1, WATCHDOG_RESETS = 2, WATCHDOG_KEY = 0x1ACCE551, AMPLIFIER = 1 };

static int from_host = -1, to_host = -1;

void tact_port_begin(tact_board *board, tact_link *link)
{
    tact_emulated_begin(board, link);
    from_host = tact_host_open("to-board", 0);
    if (from_host >= 0)
        to_host = tact_host_open("from-board", 1);
    UART_DIVISOR = 16;
    UART_CONTROL = UART_BOTH;
}

void tact_port_start_timer(float rate_hz, void (*tick)(void))
{
    tact_emulated_ticks(tick, from_host >= 0);
    tact_systick_start((uint32_t)((float)CLOCK_HZ / rate_hz + 0.5f), tact_emulated_come);
    if (from_host >= 0)
        tact_emulated_stand();
}

uint32_t tact_port_lateness(void)
{
    return tact_systick_lateness();
}

void tact_port_put_out(const int32_t *codes)
{
    tact_emulated_put_out(codes);
}

void tact_port_read_in(int32_t *codes)
{
    tact_emulated_read_in(codes);
}

uint32_t tact_port_cycles(void)
{
    return tact_emulated_cycles();
}

/* -- link ----------------------------------------------------------------------------------------------------------- */

static void doze(void)
{
    __asm volatile("wfe" ::: "memory");
}

/* Time stands still for a host that is behind, but not for one that is gone: it goes on by a tick, now and then. The
 * watchdog's time stands still with it: bytes that come one by one would let it run out between two ticks. */
static void wait_for_host(int dozes)
{
    tact_emulated_stand();
    const uint32_t clocks = WATCHDOG_LEFT;
    for (int left = dozes; left != 0 && !(UART_STATE & UART_HAS); left--)
        doze();
    if (clocks != 0)
        WATCHDOG_LOAD = clocks;
    tact_emulated_go_on();
    if (!(UART_STATE & UART_HAS))
        tact_sleep();
}

static size_t look_at_uart(uint8_t *bytes, size_t most)
{
    static uint32_t looks;
    size_t size = 0;
    while (size < most && UART_STATE & UART_HAS)
        bytes[size++] = (uint8_t)UART_DATA;
    looks = size ? 0 : looks + 1;
    if (looks > PATIENCE && tact_emulated_goes() && !tact_emulated_runs_freely()) {
        tact_sleep();
    } else if (size == 0) {
        const int behind = tact_emulated_is_behind(AN_EIGHTH);
        if (behind == TACT_KEEPS_UP)
            doze();
        else
            wait_for_host(behind == TACT_IS_SILENT ? DOZES : DOZES_WITH_ROWS);
    }
    return size;
}

size_t tact_port_receive(uint8_t *bytes, size_t most)
{
    if (from_host < 0)
        return look_at_uart(bytes, most);
    static int is_whole = 1; /* what has come ends a frame */
    if (is_whole && tact_emulated_leap())
        return 0;
    const size_t size = tact_host_read(from_host, bytes, most);
    if (size == 0)
        tact_host_exit(); /* the host is gone for good */
    is_whole = bytes[size - 1] == 0;
    return size;
}

void tact_port_send(const uint8_t *bytes, size_t size)
{
    if (to_host >= 0) {
        tact_host_write(to_host, bytes, size);
        return;
    }
    for (size_t i = 0; i < size; i++) {
        while (UART_STATE & UART_FULL) {
        }
        UART_DATA = bytes[i];
    }
}

uint32_t tact_port_enter(void)
{
    return tact_interrupts_enter();
}

void tact_port_leave(uint32_t before)
{
    tact_interrupts_leave(before);
}

/* -- safe state ----------------------------------------------------------------------------------------------------- */

/* The first light stands for the amplifier's enable. */
void tact_port_outputs_safe(void)
{
    LEDS = 0;
}

/* After WATCHDOG_CLOCKS its interrupt (NMI: tact_halt) takes the outputs to rest, after as many again it resets. */
void tact_port_outputs_on(void)
{
    if (from_host < 0 && !(WATCHDOG_CONTROL & WATCHDOG_RESETS)) {
        WATCHDOG_LOCK = WATCHDOG_KEY;
        WATCHDOG_LOAD = WATCHDOG_CLOCKS;
        WATCHDOG_CLEAR = 1; /* it counts before it may bark */
        WATCHDOG_CONTROL = WATCHDOG_INTERRUPTS | WATCHDOG_RESETS;
    }
    LEDS = AMPLIFIER;
}

/* Its count begins anew where the load is written. */
void tact_port_feed_watchdog(void)
{
    WATCHDOG_LOAD = WATCHDOG_CLOCKS;
}

int tact_port_is_sound(void)
{
    return 1;
}
