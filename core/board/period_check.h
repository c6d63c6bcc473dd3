/* Check of the interrupt: a board of its own, stepped through tact_period_step() by drawn events, and a digest of all
 * that it does.
 *
 *     seed --> events --> table, image --+--> latch, step --> codes, mode, fault, fades, trace --> digest
 *              (references, readings,    |
 *               lateness, silence,       +--> arm, start, stop, clear, off, tables swapped
 *               touches, lying sensors)
 *
 * Host and target agree in one number or differ somewhere. What runs here is what runs in the interrupt, on a copy of
 * the board's own safety table and image. Each call begins anew, so that a request for one may come again. The board that is checked stays as it is: it goes on resting in its interrupt meanwhile.
 *
 * Example use:
 *   tact_period_check_result result = tact_period_check_run(&check, &board, 1, 20000);
 */
#ifndef TACT_PERIOD_CHECK_H
#define TACT_PERIOD_CHECK_H

#include <stdint.h>

#include "arithmetic/noise.h"
#include "board/board.h"
#include "board/drawn_display.h"

enum { TACT_CHECK_ROWS = 64, TACT_CHECK_AHEAD = 24 };

typedef struct {
    uint32_t digest;
    uint32_t running; /* ticks in RUNNING, and in a fault while the command was not yet at zero */
    uint32_t starts;  /* runs that began */
    uint32_t faults;  /* 1 << fault for each that occurred */
} tact_period_check_result;

typedef struct {
    tact_board board;
    tact_drawn_display display;
    tact_noise noise;
    tact_safety safety; /* of the episode */
    tact_image image;
    float stream[TACT_CHECK_ROWS * TACT_CHANNELS_MAX];
    int32_t trace[TACT_CHECK_ROWS * TACT_CHANNELS_MAX * 2];
    uint32_t kind, event_left; /* of the stretch: what kind of reference; ticks until something happens */
    float level[TACT_CHANNELS_MAX], want[TACT_CHANNELS_MAX];
    int32_t is_silent, is_late;
    tact_period_check_result result;
} tact_period_check;

/* ticks of a board like `like` (its table, its image), from the beginning. Many take their time, and the main loop
 * hears nothing meanwhile: for a board in OFF. */
tact_period_check_result tact_period_check_run(tact_period_check *check, const tact_board *like, uint32_t seed,
                                               uint32_t ticks);

#endif
