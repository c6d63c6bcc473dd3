#include "board/board.h"

void tact_board_empty_queue(tact_board_channel *channel)
{
    for (int d = 0; d < TACT_BOARD_DELAY_MAX; d++) {
        channel->delayed[d] = channel->rest_code;
        channel->delayed_v[d] = 0.0f;
    }
}

void tact_board_empty_queues(tact_board *board)
{
    for (int c = 0; c < TACT_CHANNELS_MAX; c++)
        tact_board_empty_queue(&board->channel[c]);
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
    return board->holds && board->mode == TACT_RUNNING && board->ending == TACT_STAYS &&
           board->source == TACT_STREAM && board->tick - board->stream_at >= board->stream_end - board->stream_at;
}

int tact_board_arm(tact_board *board)
{
    if (board->mode == TACT_ARMED || board->mode == TACT_RUNNING)
        return 1;
    if (board->mode != TACT_OFF || board->safety.channels == 0 || tact_board_is_locked(board))
        return 0;
    board->fault = TACT_FAULT_NONE;
    board->ending = TACT_STAYS;
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
        board->ending = TACT_STAYS;
        for (int32_t c = 0; c < board->channels; c++)
            board->channel[c].guard.means.first = board->channel[c].guard.means.second = 0.0f;
    }
    return board->mode != TACT_FAULT;
}

/* The command's limit, drawn in to where the D/A still follows. */
static float reachable(const tact_safety_channel *safety)
{
    const tact_converter *converter = &safety->converter;
    const float step_v = converter->motor_step_v_single < 0.0f ? -converter->motor_step_v_single
                                                               : converter->motor_step_v_single;
    const float offset_v = converter->offset_v_single < 0.0f ? -converter->offset_v_single : converter->offset_v_single;
    /* float32 tells the last codes of more than 20 bits no more apart; one too many would come out with its sign turned */
    const float reach_v = (float)(converter->code_max - (converter->code_max >> 19)) * step_v - offset_v;
    return safety->command_max_v < reach_v ? safety->command_max_v : reach_v;
}

int tact_board_take_safety(tact_board *board, const tact_safety *safety)
{
    if (board->mode != TACT_OFF)
        return 0;
    board->taken++;
    board->safety = *safety;
    board->channels = safety->channels;
    board->image.channels = board->image.adapts = 0;
    board->delay_at = 0;
    board->turn = 0;
    board->turns = safety->turns;
    for (int32_t c = 0; c < board->channels; c++) {
        tact_board_channel *channel = &board->channel[c];
        const tact_converter *converter = &safety->channel[c].converter;
        board->safety.channel[c].command_max_v = reachable(&safety->channel[c]);
        channel->safety = &board->safety.channel[c];
        tact_guard_make(&channel->guard_table, channel->safety, safety->turns);
        tact_guard_reset(&channel->guard, board->ticks);
        channel->broken = 0;
        channel->to_code.first = converter->offset_v_single;
        channel->to_code.second = converter->motor_steps_per_v_single;
        channel->rest_code = tact_converter_code(converter, 0.0f);
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
        tact_board_channel *channel = &board->channel[c];
        const float most = board->safety.channel[c].command_max_v;
        tact_controller *table = &board->image.controller[c];
        table->command_max_v = table->command_max_v < most ? table->command_max_v : most;
        table->command_min_v = -table->command_max_v;
        channel->controller = &board->image.controller[c];
        channel->touch = &board->image.touch[c];
        channel->strength = &board->image.strength[c];
    }
    return 1;
}
