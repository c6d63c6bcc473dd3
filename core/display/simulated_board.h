/* Simulated board: the simulated display in the place of a board's converters, for boards in an emulator and for the host.
 *
 *     board --latch--> [ D/A, plant, load, friction, sensor, noise, hum, A/D ] x channels --read--> board
 *
 * It comes over the link as bytes (little-endian; counts are 32-bit integers, numbers float64):
 *     magic "TACW" | version 1, channels | length | seed | then for each channel: bits, polarity, range_v, offset_v |
 *     dead_time, has_late | friction stiffness, per_presliding | sensor_v_per_mm | noise_v | hum lines: count, then
 *     cosine, sine, amplitude_v | plants: count, order, then for each: a (order x order), b, late, sensor,
 *     displacement (order each), sensor_direct, displacement_direct | CRC-32
 *
 * What a finger feels lies in a ring beside the board's trace: the finger port of a rig that is not there.
 *
 * Example use, one period:
 *   tact_simulated_board_period(&simulated, &board, lateness);
 */
#ifndef TACT_SIMULATED_BOARD_H
#define TACT_SIMULATED_BOARD_H

#include <stddef.h>
#include <stdint.h>

#include "board/board.h"
#include "display/display.h"
#include "display/sensor_fault.h"
#include "link/link.h"

enum { TACT_SIMULATED_BOARD_MAGIC = 0x57434154, TACT_SIMULATED_BOARD_VERSION = 1, TACT_SIMULATED_BOARD_MAX = TACT_UPLOAD_SIZE, TACT_SIMULATED_BOARD_PLANTS_MAX = 4 };

typedef struct {
    int32_t channels; /* 0: none is described */
    uint32_t crc;
    tact_display table[TACT_CHANNELS_MAX];
    tact_plant plant[TACT_CHANNELS_MAX][TACT_SIMULATED_BOARD_PLANTS_MAX];
    tact_display_state state[TACT_CHANNELS_MAX];
    tact_sensor_fault sensor[TACT_CHANNELS_MAX];
    int32_t code[TACT_CHANNELS_MAX];   /* the last reading */
    float force_v[TACT_CHANNELS_MAX];  /* from outside, in this period */
    float *force;                      /* ring beside the board's stream */
    float *felt_mm;                    /* ring beside the board's trace */
} tact_simulated_board;

/* Nothing described. The rings have as many rows as the board's. */
void tact_simulated_board_reset(tact_simulated_board *simulated, float *force, float *felt_mm);

/* 1 if the bytes describe a display of so many channels, which is then at rest; 0 if not, and none is described. */
int tact_simulated_board_parse(tact_simulated_board *simulated, const uint8_t *bytes, size_t size, int32_t channels);

/* Registers the display's handlers with the link: its upload, touches, faults of a sensor, its rings. */
void tact_simulated_board_join(tact_simulated_board *simulated, tact_link *link);

/* The D/A's side and the A/D's, then on to the next instant. */
void tact_simulated_board_latch(tact_simulated_board *simulated, const int32_t *codes);
void tact_simulated_board_read(tact_simulated_board *simulated, int32_t *codes);
void tact_simulated_board_advance(tact_simulated_board *simulated);

/* Takes the force of the coming period (before latch); notes what is felt at this instant (before the board's step). */
void tact_simulated_board_press(tact_simulated_board *simulated, const tact_board *board);
void tact_simulated_board_feel(tact_simulated_board *simulated, const tact_board *board);

/* All of one period, unless the board waits: 1 if time passed. */
int tact_simulated_board_period(tact_simulated_board *simulated, tact_board *board, uint32_t lateness);

/* Periods until the board waits, but at most so many; how many. */
uint32_t tact_simulated_board_run(tact_simulated_board *simulated, tact_board *board, uint32_t most);

/* Whether another period passes before the host is heard, so many having passed since it was: a run goes on until it waits
 * for its stream; if it waits for none or is coming to its end, for a short while. */
int tact_simulated_board_goes_on(const tact_simulated_board *simulated, const tact_board *board, uint32_t passed);

/* These periods. */
void tact_simulated_board_go_on(tact_simulated_board *simulated, tact_board *board);

#endif
