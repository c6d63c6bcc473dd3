#include "board.h"

static void empty_queue(tact_board *board)
{
    for (int d = 0; d < TACT_BOARD_DELAY_MAX; d++)
        for (int c = 0; c < TACT_CHANNELS_MAX; c++) {
            board->delayed_code[d][c] = board->rest_code[c];
            board->delayed_flags[d][c] = 0;
        }
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

static float motor_v(const tact_converter *converter, int32_t code)
{
    return (float)code * converter->motor_step_v_single + converter->offset_v_single;
}

void tact_board_latch(tact_board *board, int32_t *codes)
{
    const int32_t slot = board->delay_at;
    for (int32_t c = 0; c < board->channels; c++) {
        const int32_t code = board->delayed_code[slot][c];
        board->out_code[c] = codes[c] = code;
        board->out_v[c] = motor_v(&board->safety.channel[c].converter, code);
    }
}

/* -- leaving ------------------------------------------------------------------------------------------------------ */

static void leave(tact_board *board, int32_t how)
{
    if (how <= board->leaving)
        return;
    board->leaving = how;
    if (how == TACT_FADES)
        board->fade_step = -1.0f / (float)board->safety.fade_ticks;
    if (how == TACT_RAMPS)
        board->authority_step = -1.0f / (float)board->safety.ramp_ticks;
    if (how == TACT_RAMPS_QUICKLY)
        board->authority_step = -1.0f / (float)board->safety.quick_ticks;
    if (how == TACT_CUT) {
        board->authority = 0.0f;
        empty_queue(board);
    }
}

static int32_t way_out(int32_t fault)
{
    if (fault == TACT_FAULT_LATE || fault == TACT_FAULT_SILENCE)
        return TACT_FADES;
    return fault == TACT_FAULT_COMFORT ? TACT_RAMPS_QUICKLY : TACT_CUT;
}

void tact_board_fail(tact_board *board, int32_t fault, int32_t channel)
{
    if (board->mode != TACT_ARMED && board->mode != TACT_RUNNING && board->mode != TACT_FAULT)
        return;
    if (board->mode != TACT_FAULT) {
        if (board->mode == TACT_ARMED) {
            board->leaving = TACT_CUT;
            board->authority = 0.0f;
        }
        board->mode = TACT_FAULT;
        board->fault = fault;
        board->fault_channel = channel;
        board->fault_tick = board->ticks;
    }
    leave(board, way_out(fault));
}

static void fail_of(tact_board *board, uint32_t faults, int32_t channel)
{
    for (int32_t fault = TACT_FAULT_SENSOR_OPEN; fault <= TACT_FAULT_NOT_A_NUMBER; fault++)
        if (faults & (1u << fault))
            tact_board_fail(board, fault, channel);
    if (board->mode == TACT_ARMED) /* no command: what moves now is moved by hand */
        return;
    if (faults & (1u << TACT_FAULT_TRAVEL))
        tact_board_fail(board, TACT_FAULT_TRAVEL, channel);
    if (faults & (1u << TACT_FAULT_COMFORT))
        tact_board_fail(board, TACT_FAULT_COMFORT, channel);
}

/* Fades move on by one tick; what has come to its end leads to what follows. */
static void move_fades(tact_board *board)
{
    board->fade += board->fade_step;
    board->authority += board->authority_step;
    if (board->fade >= 1.0f)
        board->fade = 1.0f, board->fade_step = 0.0f;
    if (board->authority >= 1.0f)
        board->authority = 1.0f, board->authority_step = 0.0f;
    if (board->leaving == TACT_STAYS)
        return;
    if (board->fade <= 0.0f) {
        board->fade = board->fade_step = 0.0f;
        leave(board, TACT_RAMPS);
    }
    if (board->authority <= 0.0f) {
        board->authority = board->authority_step = 0.0f;
        board->leaving = TACT_CUT;
        if (board->mode == TACT_RUNNING) {
            board->mode = TACT_ARMED;
            board->leaving = TACT_STAYS;
        }
    }
}

/* -- one period --------------------------------------------------------------------------------------------------- */

static inline float next_reference(tact_board *board, int32_t channel)
{
    if (board->source == TACT_STREAM) {
        const uint32_t tick = board->tick;
        if (tick - board->stream_at >= board->stream_end - board->stream_at)
            return 0.0f;
        return board->stream[(tick & (board->stream_capacity - 1)) * (uint32_t)board->channels + (uint32_t)channel];
    }
    return board->source == TACT_STIMULUS ? tact_stimulus_next(&board->stimulus[channel], board->tick) : 0.0f;
}

static inline int32_t answer(tact_board *board, int32_t channel, int32_t format, float position_v, int32_t *flags,
                             uint32_t *faults)
{
    const tact_safety_channel *safety = &board->safety.channel[channel];
    const float most = safety->command_max_v;
    float wanted = next_reference(board, channel);
    int32_t limited = 0;
    if (!board->drives) {
        const float reference = board->fade * tact_finite(wanted, safety->reference_max);
        if (format == TACT_FLOAT32) {
            tact_controller_state *state = &board->controller[channel].single;
            wanted = tact_controller_step(&board->image.tables.single[channel], state, reference, position_v);
            limited = state->clamped;
            if (state->broken)
                *faults |= 1u << TACT_FAULT_NOT_A_NUMBER;
        } else {
            tact_controller_q31_state *state = &board->controller[channel].q31;
            wanted = tact_controller_q31_step(&board->image.tables.q31[channel], state, reference, position_v);
            limited = state->clamped;
        }
    } else {
        wanted *= board->fade;
        if (!(wanted - wanted == 0.0f))
            *faults |= 1u << TACT_FAULT_NOT_A_NUMBER;
    }
    const float command_v = tact_finite(board->authority * wanted, most);
    const int32_t code = tact_converter_code(&safety->converter, command_v);
    const int32_t at_rail = code <= safety->converter.code_min || code >= safety->converter.code_max;
    *flags = limited || at_rail || command_v != board->authority * wanted ? TACT_TRACE_COMMAND_LIMITED : 0;
    return code;
}

static inline void step_channels(tact_board *board, const int32_t *codes, int32_t format, int runs)
{
    const int32_t slot = board->delay_at;
    int32_t *trace = board->trace + (size_t)(board->tick & (board->trace_capacity - 1)) * 2u * (size_t)board->channels;
    for (int32_t c = 0; c < board->channels; c++) {
        const tact_safety_channel *safety = &board->safety.channel[c];
        uint32_t faults = 0;
        int32_t flags = 0, code = board->rest_code[c];
        const float position_v = tact_guard_sense(safety, &board->guard[c], codes[c], board->out_v[c], &faults);
        if (runs) {
            const int32_t rail = codes[c] <= safety->converter.code_min || codes[c] >= safety->converter.code_max;
            code = answer(board, c, format, position_v, &flags, &faults);
            trace[c] = (int32_t)((uint32_t)board->out_code[c] & 0xffffffu) |
                       (board->delayed_flags[slot][c] | rail) << 24;
            trace[board->channels + c] = codes[c];
        }
        board->delayed_code[slot][c] = code;
        board->delayed_flags[slot][c] = flags;
        if (faults)
            fail_of(board, faults, c);
    }
}

int tact_board_waits(const tact_board *board)
{
    return board->holds && board->mode == TACT_RUNNING && board->leaving == TACT_STAYS &&
           board->source == TACT_STREAM && board->tick - board->stream_at >= board->stream_end - board->stream_at;
}

static void watch_time(tact_board *board, uint32_t lateness)
{
    board->ticks++;
    board->silence++;
    if (lateness > (uint32_t)board->safety.lateness_max) {
        board->late++;
        tact_board_fail(board, TACT_FAULT_LATE, -1);
    }
    if (board->silence > (uint32_t)board->safety.silence_ticks && board->mode == TACT_RUNNING)
        tact_board_fail(board, TACT_FAULT_SILENCE, -1);
}

void tact_board_step(tact_board *board, const int32_t *codes, uint32_t lateness)
{
    if (board->safety.channels == 0)
        return;
    watch_time(board, lateness);
    const int runs = board->mode == TACT_RUNNING || (board->mode == TACT_FAULT && board->authority > 0.0f);
    if (!runs)
        step_channels(board, codes, 0, 0);
    else if (board->image.format == TACT_FLOAT32)
        step_channels(board, codes, TACT_FLOAT32, 1);
    else
        step_channels(board, codes, TACT_Q31, 1);
    uint32_t faults = 0;
    const uint32_t compared = board->compared;
    tact_guard_compare(&board->safety.channel[compared], &board->guard[compared], &faults);
    board->compared = compared + 1 < (uint32_t)board->channels ? compared + 1 : 0;
    if (faults)
        fail_of(board, faults, (int32_t)compared);
    if (board->authority == 0.0f && board->mode == TACT_FAULT)
        empty_queue(board);
    board->delay_at = board->delay_at + 1 < board->safety.delay_samples ? board->delay_at + 1 : 0;
    if (runs) {
        board->tick++;
        if (board->fade_step != 0.0f || board->authority_step != 0.0f || board->leaving)
            move_fades(board);
    }
}

/* -- transitions -------------------------------------------------------------------------------------------------- */

int tact_board_is_at_rest(const tact_board *board)
{
    return board->mode == TACT_OFF || board->mode == TACT_ARMED ||
           (board->mode == TACT_FAULT && board->authority == 0.0f);
}

int tact_board_arm(tact_board *board)
{
    if (board->mode == TACT_ARMED || board->mode == TACT_RUNNING)
        return 1;
    if (board->mode != TACT_OFF || board->safety.channels == 0)
        return 0;
    board->fault = TACT_FAULT_NONE;
    board->leaving = TACT_STAYS;
    board->mode = TACT_ARMED;
    return 1;
}

int tact_board_start(tact_board *board, uint32_t run, int32_t source, int32_t drives, int32_t holds)
{
    if (board->mode == TACT_RUNNING && board->run == run)
        return 1;
    if (board->mode != TACT_ARMED || run <= board->run || (!drives && board->image.format == 0) ||
        (holds && !board->allows_hold))
        return 0;
    for (int32_t c = 0; c < board->channels; c++) {
        if (board->image.format == TACT_Q31)
            tact_controller_q31_reset(&board->controller[c].q31);
        else
            tact_controller_reset(&board->controller[c].single);
        tact_stimulus_rewind(&board->stimulus[c]);
    }
    empty_queue(board);
    board->run = run;
    board->tick = board->stream_at = board->stream_end = 0;
    board->source = source;
    board->drives = drives;
    board->holds = holds;
    board->silence = 0;
    board->leaving = TACT_STAYS;
    board->fade = board->authority = 0.0f;
    board->fade_step = board->authority_step = 1.0f / (float)board->safety.soft_start_ticks;
    board->mode = TACT_RUNNING;
    return 1;
}

int tact_board_stop(tact_board *board)
{
    if (board->mode == TACT_RUNNING)
        leave(board, TACT_FADES);
    return board->mode != TACT_FAULT;
}

int tact_board_off(tact_board *board)
{
    if (board->mode == TACT_ARMED)
        board->mode = TACT_OFF;
    return board->mode == TACT_OFF;
}

int tact_board_clear(tact_board *board)
{
    if (board->mode == TACT_FAULT && board->authority == 0.0f) {
        board->mode = TACT_OFF;
        board->leaving = TACT_STAYS;
        for (int32_t c = 0; c < board->channels; c++)
            board->guard[c].agreement = board->guard[c].power = 0.0f;
    }
    return board->mode != TACT_FAULT;
}

uint32_t tact_board_stream(tact_board *board, uint32_t first, const float *rows, uint32_t count)
{
    const uint32_t width = (uint32_t)board->channels;
    if (board->mode != TACT_RUNNING || board->source != TACT_STREAM)
        return board->stream_end;
    if (board->tick - board->stream_at >= board->stream_end - board->stream_at && first - board->tick < 0x40000000u)
        board->stream_at = board->stream_end = first; /* dry: a new stretch may begin now or later */
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t end = board->stream_end;
        if (first + i != end)
            continue;
        if (end - board->tick >= board->stream_capacity)
            break;
        for (uint32_t c = 0; c < width; c++)
            board->stream[(end & (board->stream_capacity - 1)) * width + c] = rows[i * width + c];
        board->stream_end = end + 1;
    }
    return board->stream_end;
}

int tact_board_take_safety(tact_board *board, const tact_safety *safety)
{
    if (board->mode != TACT_OFF)
        return 0;
    board->safety = *safety;
    board->channels = safety->channels;
    board->image.format = 0;
    board->delay_at = 0;
    board->compared = 0;
    for (int32_t c = 0; c < board->channels; c++) {
        tact_guard_reset(&board->guard[c]);
        board->rest_code[c] = tact_converter_code(&safety->channel[c].converter, 0.0f);
    }
    empty_queue(board);
    return 1;
}

int tact_board_take_image(tact_board *board, const tact_image *image)
{
    if (board->mode != TACT_OFF)
        return 0;
    board->image = *image;
    return 1;
}
