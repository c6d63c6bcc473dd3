#include "board/supervisor.h"

enum { WORDS_A_TICK = 64 };

void tact_supervisor_reset(tact_supervisor *supervisor)
{
    uint8_t *bytes = (uint8_t *)supervisor;
    for (size_t i = 0; i < sizeof *supervisor; i++)
        bytes[i] = 0;
}

static void lose(tact_supervisor *supervisor, tact_lost what)
{
    if (supervisor->lost == TACT_LOST_NOTHING)
        supervisor->lost = what;
}

/* Whether the board's mode asks for the amplifier. */
static int is_wanted(tact_supervisor *supervisor, const tact_board *board)
{
    if (board->mode != TACT_FAULT || board->command_fade > 0.0f) {
        supervisor->rest_ticks = 0;
        return board->mode != TACT_OFF && !board->bare;
    }
    supervisor->rest_ticks++;
    return !board->bare && (float)supervisor->rest_ticks <= TACT_SUPERVISOR_BRAKE_S * board->safety.rate_hz;
}

/* In any mode, whatever was lost. */
static __attribute__((noinline)) int32_t judge(tact_supervisor *supervisor, const tact_board *board,
                                               int converters_are_sound)
{
    const int wanted = is_wanted(supervisor, board);
    const uint32_t deaf = wanted ? supervisor->main_loop_silent_ticks + 1u : 0;
    supervisor->main_loop_silent_ticks = deaf;
    supervisor->deaf_most = (uint32_t)(TACT_SUPERVISOR_DEAF_S * board->safety.rate_hz);
    if (wanted && !converters_are_sound)
        lose(supervisor, TACT_LOST_CONVERTERS);
    if (deaf > supervisor->deaf_most)
        lose(supervisor, TACT_LOST_MAIN_LOOP);
    if (supervisor->lost)
        return TACT_OUTPUTS_SAFE;
    return TACT_WATCHDOG_FED | (wanted ? TACT_OUTPUTS_ON : 0);
}

int32_t tact_supervisor_tick(tact_supervisor *supervisor, const tact_board *board, int converters_are_sound)
{
    const uint32_t deaf = supervisor->main_loop_silent_ticks;
    if (board->mode != TACT_RUNNING || board->bare || !converters_are_sound || deaf >= supervisor->deaf_most ||
        supervisor->lost != TACT_LOST_NOTHING)
        return judge(supervisor, board, converters_are_sound);
    supervisor->rest_ticks = 0;
    supervisor->main_loop_silent_ticks = deaf + 1u;
    return TACT_OUTPUTS_ON | TACT_WATCHDOG_FED;
}

void tact_supervisor_heard(tact_supervisor *supervisor, const tact_board *board)
{
    supervisor->main_loop_silent_ticks = 0;
    if (supervisor->checked == board->ticks && supervisor->tables.taken == board->taken)
        return;
    supervisor->checked = board->ticks;
    if (!tact_tables_check(&supervisor->tables, board, WORDS_A_TICK))
        lose(supervisor, TACT_LOST_TABLES);
}
