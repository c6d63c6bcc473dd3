/* Any board: the core in a timer's interrupt, the link in the main loop. */

#include "port.h"

#include "board/period.h"

enum { CHANNELS = 3, STREAM_ROWS = 4096, TRACE_ROWS = 4096, CHUNK = 512 };

static tact_board board;
static tact_link link;
static float stream[STREAM_ROWS * CHANNELS];
static int32_t trace[TRACE_ROWS * CHANNELS * 2];

static void tick(void)
{
    int32_t codes[TACT_CHANNELS_MAX];
    if (tact_port_holds())
        return;
    tact_period_latch(&board, codes);
    tact_port_put_out(codes);
    tact_port_read_in(codes);
    tact_period_step(&board, codes, tact_port_lateness());
    tact_port_finish();
}

int main(void)
{
    static uint8_t bytes[CHUNK];
    float rate_hz = 0.0f;
    tact_board_reset(&board, CHANNELS, stream, STREAM_ROWS, trace, TRACE_ROWS);
    tact_link_reset(&link, &board, TACT_BOARD_NAME);
    link.enter = tact_port_enter;
    link.leave = tact_port_leave;
    tact_port_begin(&board, &link);
    for (;;) {
        const size_t size = tact_port_receive(bytes, sizeof bytes);
        for (size_t i = 0; i < size; i++)
            if (tact_link_receive(&link, bytes[i]))
                tact_port_send(link.wire, link.wire_size);
        if (board.safety.channels && board.safety.rate_hz != rate_hz) {
            rate_hz = board.safety.rate_hz;
            tact_port_start_timer(rate_hz, tick);
        }
    }
}
