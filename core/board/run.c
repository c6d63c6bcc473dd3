#include "board/run.h"

/* The soft start's first half is the command's, its second the reference's: with both at once, what is felt would not be
 * an answer to the reference. */
static float soft_step(const tact_board *board)
{
    return 2.0f / (float)board->safety.soft_start_ticks;
}

static void fade_in(tact_board *board)
{
    board->fade = board->command_fade = 0.0f;
    board->fade_step = 0.0f;
    board->command_fade_step = soft_step(board);
}

/* A run's number is one of the next few, so that none that was spoilt can use them up. */
enum { RUNS_AHEAD = 1 << 16 };

int tact_board_start(tact_board *board, uint32_t run, int32_t source, int32_t drives, int32_t holds)
{
    if (board->mode == TACT_RUNNING && board->run == run)
        return 1;
    if (board->mode != TACT_ARMED || run - board->run - 1u >= RUNS_AHEAD || (!drives && board->image.channels == 0) ||
        (holds && !board->allows_hold))
        return 0;
    for (int32_t c = 0; c < board->channels; c++) {
        tact_controller_reset(&board->image.controller[c], &board->channel[c].controller);
        tact_strength_reset(&board->channel[c].strength);
        tact_stimulus_rewind(&board->stimulus[c]);
        tact_guard_begin(&board->channel[c].guard);
        board->channel[c].is_cut = 0;
        board->channel[c].slow = 0.0f;
    }
    board->cuts = 0;
    tact_board_empty_queues(board);
    board->run = run;
    board->tick = board->stream_at = board->stream_end = board->tones_end = 0;
    board->source = source;
    board->drives = drives;
    board->holds = holds;
    board->silence = board->cycles = 0;
    board->ending = TACT_STOP_NONE;
    fade_in(board);
    board->fading = 1;
    board->mode = TACT_RUNNING;
    return 1;
}

/* The run ends in this way (TACT_FADE_REFERENCE...), unless a graver one has begun. */
static void leave(tact_board *board, int32_t how)
{
    if (how <= board->ending)
        return;
    board->ending = how;
    board->fading = 1;
    if (how == TACT_FADE_REFERENCE)
        board->fade_step = -1.0f / (float)board->safety.fade_ticks;
    if (how == TACT_FADE_COMMAND)
        board->command_fade_step = -1.0f / (float)board->safety.ramp_ticks;
    if (how == TACT_FADE_COMMAND_FAST)
        board->command_fade_step = -1.0f / (float)board->safety.quick_ticks;
    if (how == TACT_CUT) {
        board->command_fade = board->command_fade_step = 0.0f; /* a soft start that has just begun ends here too */
        tact_board_empty_queues(board);
    }
}

/* One channel's command at zero from now on. The others, cut in mid-stroke, would be carried beyond comfort: they fade. */
static void cut(tact_board *board, int32_t channel)
{
    if (board->channel[channel].is_cut)
        return;
    board->channel[channel].is_cut = 1;
    board->cuts++;
    tact_board_empty_queue(board, channel);
    leave(board, board->cuts < board->channels ? TACT_FADE_REFERENCE : TACT_CUT);
}

static int32_t fault_reaction(int32_t fault)
{
    if (fault == TACT_FAULT_LATE || fault == TACT_FAULT_SILENCE)
        return TACT_FADE_REFERENCE;
    return fault == TACT_FAULT_COMFORT ? TACT_FADE_COMMAND_FAST : TACT_CUT;
}

static void fail(tact_board *board, int32_t fault, int32_t channel)
{
    if (board->mode != TACT_FAULT) {
        board->sensor_faults += (uint32_t)tact_board_fault_is_of_sensor_or_travel(fault);
        if (board->mode == TACT_ARMED) {
            board->ending = TACT_CUT;
            board->command_fade = 0.0f;
        }
        board->mode = TACT_FAULT;
        board->fault = fault;
        board->fault_channel = channel;
        board->fault_tick = board->ticks;
    }
    if (fault_reaction(fault) == TACT_CUT)
        cut(board, channel);
    else
        leave(board, fault_reaction(fault));
}

void tact_board_fail(tact_board *board, uint32_t faults, int32_t channel)
{
    if (board->mode == TACT_OFF)
        return;
    if (board->mode == TACT_ARMED) /* no command: what moves now is moved by hand */
        faults &= ~(1u << TACT_FAULT_TRAVEL | 1u << TACT_FAULT_COMFORT | 1u << TACT_FAULT_SENSOR_STUCK);
    for (int32_t fault = TACT_FAULT_LAST; fault > TACT_FAULT_NONE; fault--)
        if (faults & (1u << fault))
            fail(board, fault, channel);
}

void tact_board_see_to(tact_board *board)
{
    for (int32_t c = 0; c < board->channels; c++) {
        tact_board_channel *channel = &board->channel[c];
        const int32_t broken = channel->broken, violated = channel->guard.violated;
        channel->broken = channel->guard.violated = 0;
        if (broken)
            tact_board_fail(board, 1u << TACT_FAULT_NOT_A_NUMBER, c);
        if (violated)
            tact_board_fail(board, tact_guard_name(&board->safety.channel[c], &channel->guard, board->ticks), c);
    }
}

void tact_board_silence_cut(tact_board *board)
{
    for (int32_t c = 0; c < board->channels; c++)
        if (board->channel[c].is_cut)
            tact_board_put_rest(board, c, board->delay_at);
}

int tact_board_stop(tact_board *board)
{
    if (board->mode == TACT_RUNNING)
        leave(board, TACT_FADE_REFERENCE);
    return board->mode != TACT_FAULT;
}

void tact_board_fade(tact_board *board)
{
    board->fade += board->fade_step;
    board->command_fade += board->command_fade_step;
    if (board->fade >= 1.0f)
        board->fade = 1.0f, board->fade_step = 0.0f;
    if (board->command_fade >= 1.0f) {
        board->command_fade = 1.0f, board->command_fade_step = 0.0f;
        if (board->fade == 0.0f) /* where the run ends, it ends below */
            board->fade_step = soft_step(board);
    }
    if (board->ending != TACT_STOP_NONE && board->fade <= 0.0f) {
        board->fade = board->fade_step = 0.0f;
        leave(board, TACT_FADE_COMMAND);
    }
    if (board->ending != TACT_STOP_NONE && board->command_fade <= 0.0f) {
        board->command_fade = board->command_fade_step = 0.0f;
        board->ending = board->mode == TACT_RUNNING ? TACT_STOP_NONE : TACT_CUT;
        if (board->mode == TACT_RUNNING)
            board->mode = TACT_ARMED;
    }
    board->fading = board->fade_step != 0.0f || board->command_fade_step != 0.0f;
}
