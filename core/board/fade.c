#include "board/fade.h"

/* The soft start's first half is the command's, its second the reference's: with both at once, what is felt would not be
 * an answer to the reference. */
static float soft_step(const tact_board *board)
{
    return 2.0f / (float)board->safety.soft_start_ticks;
}

void tact_board_fade_in(tact_board *board)
{
    board->fade = board->command_fade = 0.0f;
    board->fade_step = 0.0f;
    board->command_fade_step = soft_step(board);
}

void tact_board_fade(tact_board *board)
{
    board->fade += board->fade_step;
    board->command_fade += board->command_fade_step;
    if (board->fade >= 1.0f)
        board->fade = 1.0f, board->fade_step = 0.0f;
    if (board->command_fade >= 1.0f) {
        board->command_fade = 1.0f, board->command_fade_step = 0.0f;
        if (board->ending == TACT_STAYS && board->fade == 0.0f)
            board->fade_step = soft_step(board);
    }
    if (board->ending != TACT_STAYS && board->fade <= 0.0f) {
        board->fade = board->fade_step = 0.0f;
        tact_board_leave(board, TACT_RAMPS);
    }
    if (board->ending != TACT_STAYS && board->command_fade <= 0.0f) {
        board->command_fade = board->command_fade_step = 0.0f;
        board->ending = board->mode == TACT_RUNNING ? TACT_STAYS : TACT_CUT;
        if (board->mode == TACT_RUNNING)
            board->mode = TACT_ARMED;
    }
    board->fading = board->fade_step != 0.0f || board->command_fade_step != 0.0f;
    board->steady = !board->fading && board->mode == TACT_RUNNING && board->ending == TACT_STAYS &&
                    board->fade == 1.0f && board->command_fade == 1.0f && board->runs_designed &&
                    board->safety.delay_samples == 1;
}
