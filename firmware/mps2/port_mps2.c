/* MPS2 under QEMU (AN386: Cortex-M4F, AN500: Cortex-M7): SysTick, FIFOs of the host or UART 0, and the simulated
 * display in the place of converters. Between runs the display's time stands still, so that what a board plays does
 * not depend on how long the host takes.
 *
 * Over FIFOs a read waits for the host, and no time passes on the board: before it waits, a run goes on until it has
 * come to its end or is dry, for BREATH ticks if it never waits for its stream, or for SETTLE in a fault.
 *
 * Over the UART time goes on, as on a real board: the main loop looks for bytes while the interrupt comes and goes. The
 * timer stands still while the display is computed, which no real board does. Where the emulator's time follows the
 * instructions, a sleep until the next interrupt (WFI) would leap there at once, so a free run only dozes: WFE is one
 * instruction of the board and leaves the machine to the host meanwhile, for longer where the host is behind. */

#include "board/period.h"
#include "display/simulated_board.h"
#include "port.h"
#include "semihosting.h"

enum { CLOCK_HZ = 25000000, RELOAD_MAX = 0xffffff, BREATH = 32, SETTLE = 8192, LONGEST = 65536, STREAM_ROWS = 4096 };
enum { PATIENCE = 4096 };                     /* looks at a silent UART before sleep */
enum { BEHIND_TICKS = 64, BEHIND_ROWS = 256 }; /* a host that is silent for longer, or has fed less ahead, is behind */

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define SYSTICK_CONTROL REGISTER(0xE000E010u)
#define SYSTICK_RELOAD REGISTER(0xE000E014u)
#define SYSTICK_VALUE REGISTER(0xE000E018u)
#define UART_DATA REGISTER(0x40004000u)
#define UART_STATE REGISTER(0x40004004u)
#define UART_CONTROL REGISTER(0x40004008u)
#define UART_DIVISOR REGISTER(0x40004010u)
enum { SYSTICK_ENABLED = 1, SYSTICK_COUNTS = 5, SYSTICK_RUNS = 7, SYSTICK_WRAPPED = 1 << 16 };
enum { UART_FULL = 1, UART_HAS = 2, UART_BOTH = 3 };

void tact_systick(void);

static tact_board *the_board;
static tact_simulated_board simulated;
static float force[STREAM_ROWS * TACT_CHANNELS_MAX], felt_mm[STREAM_ROWS * TACT_CHANNELS_MAX];
static int from_host = -1, to_host = -1;
static void (*the_tick)(void);
static uint32_t timer, missed, lateness; /* timer: SYSTICK_CONTROL when it runs */

static void count_instructions(uint32_t samples, uint32_t *counts);

void tact_port_begin(tact_board *board, tact_link *link)
{
    the_board = board;
    tact_simulated_board_reset(&simulated, force, felt_mm);
    board->allows_hold = 1;
    tact_simulated_board_join(&simulated, link);
    link->bench = count_instructions;
    from_host = tact_host_open("to-board", 0);
    if (from_host >= 0)
        to_host = tact_host_open("from-board", 1);
    UART_DIVISOR = 16;
    UART_CONTROL = UART_BOTH;
}

void tact_port_start_timer(float rate_hz, void (*tick)(void))
{
    the_tick = tick;
    SYSTICK_CONTROL = 0;
    SYSTICK_RELOAD = (uint32_t)((float)CLOCK_HZ / rate_hz + 0.5f) - 1u;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = timer = SYSTICK_RUNS;
}

void tact_systick(void)
{
    const uint32_t reload = SYSTICK_RELOAD, value = SYSTICK_VALUE; /* reads 0 at the wrap itself */
    (void)SYSTICK_CONTROL; /* takes back the mark of the wrap that brought us here */
    lateness = (value == 0 ? 0 : reload - value) * 256u / (reload + 1u) + missed;
    the_tick();
    missed = SYSTICK_CONTROL & SYSTICK_WRAPPED ? 256u : 0u;
}

uint32_t tact_port_lateness(void)
{
    return lateness;
}

int tact_port_holds(void)
{
    const int rests = the_board->ending == TACT_STAYS && the_board->mode != TACT_RUNNING;
    return simulated.channels != the_board->channels || rests || tact_board_waits(the_board);
}

/* What the display's computation takes is no time of the board's. */
static void timer_stands(void)
{
    SYSTICK_CONTROL = timer & ~(uint32_t)SYSTICK_ENABLED;
}

static void timer_goes_on(void)
{
    SYSTICK_CONTROL = timer;
}

void tact_port_put_out(const int32_t *codes)
{
    timer_stands();
    tact_simulated_board_press(&simulated, the_board);
    tact_simulated_board_latch(&simulated, codes);
    timer_goes_on();
}

void tact_port_read_in(int32_t *codes)
{
    timer_stands();
    tact_simulated_board_read(&simulated, codes);
    tact_simulated_board_feel(&simulated, the_board);
    timer_goes_on();
}

void tact_port_finish(void)
{
    timer_stands();
    tact_simulated_board_advance(&simulated);
    timer_goes_on();
}

static void sleep(void)
{
    __asm volatile("wfi" ::: "memory");
}

/* Ticks that may pass before the host is waited for: in a fault the motor coasts to rest, and the guard finds back to a
 * sensor that has been mended. */
static uint32_t breath(const volatile tact_board *board)
{
    if (board->mode == TACT_FAULT)
        return SETTLE;
    return board->holds && board->ending == TACT_STAYS ? LONGEST : BREATH;
}

static void let_run(void)
{
    const volatile tact_board *board = the_board;
    const uint32_t begun = board->ticks;
    while (SYSTICK_CONTROL & SYSTICK_ENABLED && !tact_port_holds() && board->ticks - begun < breath(board))
        sleep();
}

static int runs_freely(const volatile tact_board *board)
{
    return board->mode == TACT_RUNNING && !board->holds;
}

static void doze(const volatile tact_board *board)
{
    const uint32_t ahead = board->stream_end - board->tick;
    if (runs_freely(board) && (board->silence > BEHIND_TICKS || (ahead != 0 && ahead < BEHIND_ROWS)))
        __asm volatile(".rept 15\n wfe\n .endr" ::: "memory");
    __asm volatile("wfe" ::: "memory");
}

static size_t look_at_uart(uint8_t *bytes, size_t most)
{
    static uint32_t looks;
    const volatile tact_board *board = the_board;
    size_t size = 0;
    while (size < most && UART_STATE & UART_HAS)
        bytes[size++] = (uint8_t)UART_DATA;
    looks = size ? 0 : looks + 1;
    if (looks > PATIENCE && SYSTICK_CONTROL & SYSTICK_ENABLED && !runs_freely(board))
        sleep();
    else if (size == 0)
        doze(board);
    return size;
}

size_t tact_port_receive(uint8_t *bytes, size_t most)
{
    if (from_host < 0)
        return look_at_uart(bytes, most);
    let_run();
    const size_t size = tact_host_read(from_host, bytes, most);
    if (size == 0)
        tact_host_exit(); /* the host is gone for good */
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

void tact_port_enter(void)
{
    __asm volatile("cpsid i" ::: "memory");
}

void tact_port_leave(void)
{
    __asm volatile("cpsie i" ::: "memory");
}

static uint32_t since(uint32_t before)
{
    return (before - SYSTICK_VALUE) & RELOAD_MAX;
}

/* Periods in the main loop, the timer free-running and silent: what the board's part of each takes, the display's part
 * left out. In counts of the timer; under -icount they are instructions, times a constant. */
static void count_instructions(uint32_t samples, uint32_t *counts)
{
    int32_t codes[TACT_CHANNELS_MAX];
    SYSTICK_CONTROL = 0;
    SYSTICK_RELOAD = RELOAD_MAX;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = timer = SYSTICK_COUNTS;
    counts[0] = RELOAD_MAX;
    const uint32_t begun = SYSTICK_VALUE;
    const uint32_t reading = since(begun); /* what it takes to look at the timer */
    for (uint32_t k = 0; k < samples; k++) {
        uint32_t before = SYSTICK_VALUE;
        tact_period_latch(the_board, codes);
        uint32_t count = since(before) - reading;
        tact_port_put_out(codes);
        tact_port_read_in(codes);
        before = SYSTICK_VALUE;
        tact_period_step(the_board, codes, 0);
        count += since(before) - reading;
        tact_port_finish();
        counts[0] = count < counts[0] ? count : counts[0];
        counts[1] = count > counts[1] ? count : counts[1];
        counts[2] += count;
    }
    SYSTICK_CONTROL = 0;
}
