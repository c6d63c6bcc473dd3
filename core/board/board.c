#include "board/board.h"

void tact_board_put_rest(tact_board *board, int32_t channel, int32_t slot)
{
    board->channel[channel].delayed_v[slot] = 0.0f;
    board->channel[channel].delayed[slot] = board->safety.channel[channel].converter.rest_code & 0xffffff;
}

void tact_board_empty_queue(tact_board *board, int32_t channel)
{
    for (int32_t slot = 0; slot < TACT_BOARD_DELAY_MAX; slot++)
        tact_board_put_rest(board, channel, slot);
}

void tact_board_empty_queues(tact_board *board)
{
    for (int32_t c = 0; c < board->channels; c++)
        tact_board_empty_queue(board, c);
}

void tact_board_reset(tact_board *board, int32_t channels_max, float *stream, uint32_t stream_capacity, int32_t *trace,
                      uint32_t trace_capacity)
{
    uint8_t *bytes = (uint8_t *)board;
    for (size_t i = 0; i < sizeof *board; i++)
        bytes[i] = 0;
    board->channels = board->channels_max = channels_max;
    board->stream = stream;
    board->stream_capacity = stream_capacity;
    board->trace = trace;
    board->trace_capacity = trace_capacity;
}

int tact_board_fault_is_of_sensor_or_travel(int32_t fault)
{
    return fault >= TACT_FAULT_TRAVEL && fault <= TACT_FAULT_SENSOR_JUMPS;
}

int tact_board_is_at_rest(const tact_board *board)
{
    return board->mode == TACT_OFF || board->mode == TACT_ARMED ||
           (board->mode == TACT_FAULT && board->command_fade == 0.0f);
}

int tact_board_waits(const tact_board *board)
{
    return board->holds && board->mode == TACT_RUNNING && board->ending == TACT_STOP_NONE &&
           board->source == TACT_STREAM && board->tick - board->stream_at >= board->stream_end - board->stream_at;
}

int tact_board_arm(tact_board *board)
{
    if (board->mode == TACT_ARMED || board->mode == TACT_RUNNING)
        return 1;
    if (board->mode != TACT_OFF || board->safety.channels == 0 || tact_board_is_locked(board))
        return 0;
    board->fault = TACT_FAULT_NONE;
    board->ending = TACT_STOP_NONE;
    board->mode = TACT_ARMED;
    return 1;
}

int tact_board_off(tact_board *board)
{
    if (board->mode == TACT_ARMED)
        board->mode = TACT_OFF;
    return board->mode == TACT_OFF;
}

uint32_t tact_board_locked_ticks(const tact_board *board)
{
    const uint32_t passed = board->ticks - board->fault_tick, whole = (uint32_t)board->safety.lock_ticks;
    return board->mode == TACT_FAULT && tact_board_fault_is_of_sensor_or_travel(board->fault) && passed < whole ? whole - passed : 0;
}

int tact_board_is_locked(const tact_board *board)
{
    return board->sensor_faults - board->acknowledged >= (uint32_t)board->safety.lock_faults;
}

int tact_board_acknowledge(tact_board *board, uint32_t count)
{
    if (count > board->sensor_faults)
        return 0;
    board->acknowledged = count > board->acknowledged ? count : board->acknowledged;
    return 1;
}

int tact_board_clear(tact_board *board)
{
    if (board->mode == TACT_FAULT && board->command_fade == 0.0f && tact_board_locked_ticks(board) == 0) {
        board->mode = TACT_OFF;
        board->ending = TACT_STOP_NONE;
        for (int32_t c = 0; c < board->channels; c++)
            board->channel[c].guard.agreement = board->channel[c].guard.power = 0.0f;
    }
    return board->mode != TACT_FAULT;
}

int tact_board_take_safety(tact_board *board, const tact_safety *safety)
{
    if (board->mode != TACT_OFF)
        return 0;
    board->taken++;
    board->safety = *safety;
    board->channels = safety->channels;
    board->image.channels = 0;
    board->delay_at = 0;
    board->turn = 0;
    for (int32_t c = 0; c < board->channels; c++) {
        tact_guard_reset(&board->channel[c].guard, board->ticks);
        board->channel[c].broken = 0;
    }
    tact_board_empty_queues(board);
    return 1;
}

int tact_board_take_image(tact_board *board, const tact_image *image)
{
    if (board->mode != TACT_OFF)
        return 0;
    board->taken++;
    board->image = *image;
    for (int32_t c = 0; c < board->channels; c++) {
        tact_controller *table = &board->image.controller[c];
        const float most = board->safety.channel[c].command_max_v;
        table->command_max_v = table->command_max_v < most ? table->command_max_v : most;
    }
    return 1;
}
