/* Any board: the core in a timer's interrupt, the link in the main loop, the supervisor over both. */

#include "port.h"

#include "board/period.h"
#include "board/supervisor.h"

enum { CHANNELS = 3, CHUNK = 512, SENT_AT_ONCE = 256, TONES_AT_ONCE = 4 };

static tact_board board;
static tact_link link;
static tact_supervisor supervisor;
static float stream[TACT_STREAM_ROWS * CHANNELS];
static int32_t trace[TACT_TRACE_ROWS * CHANNELS * 2];

static void supervise(void)
{
    const int32_t allowed = tact_supervisor_tick(&supervisor, &board, tact_port_is_sound());
    if (allowed & TACT_OUTPUTS_ON)
        tact_port_outputs_on();
    else
        tact_port_outputs_safe();
    if (allowed & TACT_WATCHDOG_FED)
        tact_port_feed_watchdog();
}

static void tick(void)
{
    int32_t codes[TACT_CHANNELS_MAX];
    tact_period_latch(&board, codes);
    tact_port_put_out(codes);
    tact_port_read_in(codes);
    const uint32_t began = tact_port_cycles();
    tact_period_step(&board, codes, tact_port_lateness());
    supervise();
    const uint32_t taken = tact_port_cycles() - began;
    board.cycles = taken > board.cycles ? taken : board.cycles;
}

static void send(const uint8_t *bytes, size_t size)
{
    for (size_t at = 0; at < size; at += SENT_AT_ONCE) {
        tact_port_send(bytes + at, size - at < SENT_AT_ONCE ? size - at : SENT_AT_ONCE);
        tact_supervisor_heard(&supervisor, &board);
    }
}

/* Some samples of the board's own tones, where they are due. */
static void give_tones(void)
{
    float row[TACT_CHANNELS_MAX];
    for (int i = 0; i < TONES_AT_ONCE && tact_board_wants_tones(&board); i++) {
        tact_board_make_tones(&board, row);
        const uint32_t before = tact_port_enter();
        tact_board_take_tones(&board, row);
        tact_port_leave(before);
    }
}

int main(void)
{
    static const uint8_t FRAMES_END = 0;
    static uint8_t bytes[CHUNK];
    float rate_hz = 0.0f;
    tact_board_reset(&board, CHANNELS, stream, TACT_STREAM_ROWS, trace, TACT_TRACE_ROWS);
    tact_link_reset(&link, &board, TACT_BOARD_NAME);
    tact_supervisor_reset(&supervisor);
    link.enter = tact_port_enter;
    link.leave = tact_port_leave;
    tact_port_begin(&board, &link);
    tact_port_send(&FRAMES_END, 1); /* the board is there; what was half a frame ends here */
    for (;;) {
        const size_t size = tact_port_receive(bytes, sizeof bytes);
        tact_supervisor_heard(&supervisor, &board);
        give_tones();
        for (size_t i = 0; i < size; i++)
            if (tact_link_receive(&link, bytes[i]))
                send(link.wire, link.wire_size);
        if (board.safety.channels && board.safety.rate_hz != rate_hz) {
            rate_hz = board.safety.rate_hz;
            tact_port_start_timer(rate_hz, tick);
        }
    }
}
