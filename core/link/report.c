#include "link/report.h"

int32_t tact_report_status(const tact_link *link, tact_writer *out)
{
    const tact_board *board = link->board;
    for (int i = 0; i < TACT_BOARD_NAME_SIZE; i++)
        tact_write_u8(out, link->name[i]);
    tact_write_u8(out, (uint8_t)board->channels_max);
    tact_write_u8(out, (uint8_t)board->mode);
    tact_write_u8(out, (uint8_t)board->fault);
    tact_write_u8(out, (uint8_t)(board->fault_channel & 255));
    tact_write_u8(out, (uint8_t)tact_board_is_at_rest(board));
    tact_write_u8(out, (uint8_t)board->allows_hold);
    tact_write_u8(out, (uint8_t)board->safety.delay_samples);
    tact_write_f32(out, board->safety.rate_hz);
    tact_write_u32(out, board->safety.channels ? board->safety.crc : 0);
    tact_write_u32(out, board->image.channels ? board->image.crc : 0);
    tact_write_u32(out, link->display.take ? *link->display.crc : 0);
    tact_write_u32(out, board->stream_capacity);
    tact_write_u32(out, board->trace_capacity);
    tact_write_u32(out, board->run);
    tact_write_u32(out, board->tick);
    tact_write_u32(out, board->ticks);
    tact_write_u32(out, board->late);
    tact_write_u32(out, board->stream_end);
    tact_write_u32(out, link->heard);
    tact_write_u32(out, link->dropped);
    tact_write_u32(out, board->fault_tick);
    tact_write_u32(out, board->sensor_faults);
    tact_write_u32(out, board->acknowledged);
    tact_write_u32(out, tact_board_locked_ticks(board));
    tact_write_u32(out, board->cycles);
    tact_write_u32(out, (uint32_t)tact_link_missing(link));
    return TACT_DONE;
}

static void write_rows(const tact_link *link, tact_writer *out, uint32_t first, uint32_t count, int felt)
{
    const tact_board *board = link->board;
    const uint32_t width = (uint32_t)board->channels;
    for (uint32_t k = 0; k < count; k++) {
        const uint32_t row = (first + k) & (board->trace_capacity - 1);
        const int32_t *words = board->trace + (size_t)(row * 2u * width);
        for (uint32_t c = 0; c < width; c++)
            tact_write_u32(out, (uint32_t)words[(size_t)(2u * c)]);
        for (uint32_t c = 0; c < width; c++)
            tact_write_u32(out, (uint32_t)words[(size_t)(2u * c + 1u)]);
        for (uint32_t c = 0; c < width && felt; c++)
            tact_write_f32(out, link->display.felt_mm[row * width + c]);
    }
}

int32_t tact_report_trace(const tact_link *link, tact_reader *in, tact_writer *out)
{
    const tact_board *board = link->board;
    const uint32_t run = tact_read_u32(in), first = tact_read_u32(in);
    uint32_t count = tact_read_u16(in);
    const int felt = tact_read_u8(in) != 0;
    const uint32_t row_size = (uint32_t)board->channels * (felt ? 12u : 8u);
    if (in->overrun || in->at != in->size || (felt && !link->display.take))
        return TACT_BAD_PAYLOAD;
    if (run != board->run)
        return TACT_OTHER_RUN;
    const uint32_t tick = board->tick;
    if (first > tick || tick - first > board->trace_capacity)
        return TACT_NOT_HERE;
    if (count > tick - first)
        count = tick - first;
    if (count > (TACT_PAYLOAD_MAX - 16u) / row_size)
        count = (TACT_PAYLOAD_MAX - 16u) / row_size;
    tact_write_u32(out, first);
    tact_write_u16(out, (uint16_t)count);
    write_rows(link, out, first, count, felt);
    return board->tick - first > board->trace_capacity ? TACT_NOT_HERE : TACT_DONE;
}

int32_t tact_report_weights(const tact_link *link, const tact_reader *in, tact_writer *out)
{
    const tact_board *board = link->board;
    if (in->size != 0)
        return TACT_BAD_PAYLOAD;
    tact_write_u32(out, board->tick);
    for (int32_t c = 0; c < board->channels; c++) {
        const int adapts = board->image.channels != 0 && board->image.controller[c].touch.delay != 0;
        for (int i = 0; i < 2; i++)
            tact_write_f32(out, adapts ? board->channel[c].controller.touch.weight[i] : 0.0f);
    }
    return TACT_DONE;
}
