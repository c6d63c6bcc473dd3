/* Supervisor: whether the amplifier may be on, and whether the watchdog is fed. Both need interrupt and main loop alive.
 *
 *                          +--> outputs on, while the board is armed, runs, or has just come to rest from a fault
 *     interrupt --tick-----+
 *     main loop --heard--> +--> watchdog fed
 *                          |
 *     tables, converters --+--> lost: outputs safe, watchdog unfed, until the processor is reset by it
 *
 * A stopped or masked interrupt feeds nothing: the watchdog's own time runs out. A stuck main loop is noticed by the
 * interrupt. With the outputs safe (OFF) the main loop may take its time.
 * After a fault the amplifier stays on for a while at a command of zero: a motor whose terminals are held brakes itself.
 *
 * Example use, in the interrupt:
 *   const int32_t allowed = tact_supervisor_tick(&supervisor, &board, converters_are_sound);
 *   in the main loop: tact_supervisor_heard(&supervisor, &board);
 */
#ifndef TACT_SUPERVISOR_H
#define TACT_SUPERVISOR_H

#include <stdint.h>

#include "board/board.h"
#include "board/tables.h"

#define TACT_SUPERVISOR_DEAF_S 0.008f  /* a main loop that is silent for longer is stuck */
#define TACT_SUPERVISOR_BRAKE_S 0.25f

enum { TACT_OUTPUTS_SAFE = 0, TACT_OUTPUTS_ON = 1, TACT_WATCHDOG_FED = 2 };
typedef enum { TACT_LOST_NOTHING = 0, TACT_LOST_MAIN_LOOP, TACT_LOST_CONVERTERS, TACT_LOST_TABLES } tact_lost;

typedef struct {
    volatile uint32_t main_loop_silent_ticks; /* since the main loop was heard; while outputs are on */
    volatile int32_t lost;        /* the first tact_lost, until a reset */
    uint32_t deaf_most;           /* ticks of TACT_SUPERVISOR_DEAF_S, once the table's rate is known */
    uint32_t rest_ticks;          /* since a fault's command came to zero */
    uint32_t checked;             /* the board's tick at which tables were looked at last */
    tact_tables tables;
} tact_supervisor;

void tact_supervisor_reset(tact_supervisor *supervisor);

/* At the end of every interrupt: TACT_OUTPUTS_ON | TACT_WATCHDOG_FED, or what of that is left. */
int32_t tact_supervisor_tick(tact_supervisor *supervisor, const tact_board *board, int converters_are_sound);

/* From the main loop, and from what it does that may take long; looks at some of the tables. */
void tact_supervisor_heard(tact_supervisor *supervisor, const tact_board *board);

#endif
