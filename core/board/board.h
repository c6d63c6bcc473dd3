/* Board: what runs in the timer interrupt, for all channels, whatever the processor.
 *
 *     latch: codes to the D/A                            OFF --arm--> ARMED --start--> RUNNING --stop--> ARMED
 *     (converters)                                        ^             |                 |
 *     step:  codes of the A/D --> guard --> filters       +----off------+    any fault    v
 *            --> guard --> codes for a later latch        +------clear------------------ FAULT
 *
 * Readings become volts, the guard looks at them, the controller of the loaded image answers a reference (limited to
 * comfort), the answer is clamped and becomes a code, delay_samples later put out. Sensor and travel faults and
 * arithmetic that broke cut that channel's command at the next latch; comfort fades all out in quick_ticks; a late
 * interrupt, a silent link, a stop and another channel's cut fade the reference out, then the command. The first fault
 * latches and is named. After a sensor or travel fault CLEAR is refused until lock_ticks have passed, and ARM after
 * lock_faults of them until a person has acknowledged them: a sensor that lies must not drive the motor on by clearing.
 *
 * The reference comes from a stream (samples for given ticks of the run, kept in a ring), from the stimulus on the
 * board (whose samples are made outside of the interrupt, some ticks ahead, and go into the same ring), or is zero. With `hold` the run waits, without time passing, while the stream is dry: for boards whose
 * display is simulated. Drive puts the stream straight to the motors, through the guard but no controller.
 * The caller owns rings: stream_capacity rows of channels_max floats, trace_capacity rows of channels_max codes, twice.
 *
 * Example use, in the interrupt (period.h):
 *   int32_t code[TACT_CHANNELS_MAX];
 *   tact_period_latch(&board, code);                    put them out, read the A/D into code
 *   tact_period_step(&board, code, lateness_in_256ths_of_a_period);
 */
#ifndef TACT_BOARD_H
#define TACT_BOARD_H

#include <stddef.h>
#include <stdint.h>

#include "board/guard.h"
#include "board/image.h"
#include "board/safety.h"
#include "board/stimulus.h"

enum { TACT_BOARD_DELAY_MAX = 8, TACT_TONES_AHEAD = 32 };
typedef enum { TACT_OFF = 0, TACT_ARMED, TACT_RUNNING, TACT_FAULT } tact_board_mode;
typedef enum { TACT_SILENT = 0, TACT_STREAM, TACT_STIMULUS } tact_board_source;
typedef enum { TACT_STOP_NONE = 0, TACT_FADE_REFERENCE, TACT_FADE_COMMAND, TACT_FADE_COMMAND_FAST, TACT_CUT } tact_board_ending;
enum { TACT_TRACE_COMMAND_LIMITED = 1 };

/* The states of one channel. */
typedef struct {
    tact_controller_state controller;
    tact_guard_state guard;
    float delayed_v[TACT_BOARD_DELAY_MAX]; /* what will be put out: at the motor, but for the D/A's last bit */
    int32_t delayed[TACT_BOARD_DELAY_MAX]; /* its code in 24 bits | TACT_TRACE_... << 24 */
    int32_t broken;                        /* the command was no number, and nobody has seen to it */
    int32_t is_cut;                        /* until the next run: nothing is put out any more */
    float slow;                            /* part of the reference, within travel_max */
    tact_strength_state strength;
} tact_board_channel;

typedef struct {
    int32_t mode, fault, fault_channel, ending;
    int32_t source, drives, holds, allows_hold;
    int32_t bare;         /* armed to compute alone: the outputs stay safe */
    uint32_t run;         /* number of the run, given by who starts it */
    uint32_t tick;        /* of the run */
    uint32_t ticks;       /* since the board began */
    uint32_t silence;     /* ticks since the link was heard */
    uint32_t fault_tick;
    uint32_t sensor_faults, acknowledged; /* faults of a sensor or of travel since the board began; those that a person knows of */
    uint32_t late;        /* interrupts that came too late */
    uint32_t cycles;      /* of the processor: the most that any step of this run took with its supervisor, as the port counts */
    uint32_t taken;       /* safety tables and images, since the board began */
    float fade, command_fade; /* of the reference, of the command */
    float fade_step, command_fade_step;
    int32_t fading; /* one of the two steps is not zero */
    int32_t cuts;   /* channels that are cut */
    int32_t turn; /* the channels at turn, turn + turns, ... are compared next */
    int32_t delay_at;
    int32_t channels, channels_max; /* in use (the table says), and of the board */
    float *stream;
    uint32_t stream_capacity, stream_at, stream_end; /* ticks of the run; stream_at: first of the unbroken samples */
    uint32_t tones_end; /* tick up to which the stimulus has been asked */
    int32_t *trace; /* rows; of each channel the command's code as in `delayed`, and the position's */
    uint32_t trace_capacity;
    tact_board_channel channel[TACT_CHANNELS_MAX];
    tact_stimulus stimulus[TACT_CHANNELS_MAX];
    tact_safety safety; /* image follows: both are checked as one piece (tables.h) */
    tact_image image;
} tact_board;

/* value within +/- most; NaN gives 0. */
static inline float tact_board_within(float value, float most)
{
    if (__builtin_fabsf(value) <= most)
        return value;
    return value > most ? most : value < -most ? -most : 0.0f;
}

/* OFF, with neither table nor image. Capacities are powers of two. */
void tact_board_reset(tact_board *board, int32_t channels_max, float *stream, uint32_t stream_capacity, int32_t *trace,
                      uint32_t trace_capacity);

/* A command at zero into a place of a channel's queue; into all places of one channel, of all channels. */
void tact_board_put_rest(tact_board *board, int32_t channel, int32_t slot);
void tact_board_empty_queue(tact_board *board, int32_t channel);
void tact_board_empty_queues(tact_board *board);

/* Transitions without a run (run.h has the others). 1: done, or done before; 0: not from this mode. */
int tact_board_arm(tact_board *board);
int tact_board_off(tact_board *board);
int tact_board_clear(tact_board *board);

/* A person knows of `count` sensor and travel faults since the board began: 1 if there were so many. */
int tact_board_acknowledge(tact_board *board, uint32_t count);

/* Whether a fault is of those that lock: a sensor that lies, a motor that went too far. */
int tact_board_fault_is_of_sensor_or_travel(int32_t fault);

/* Ticks until a fault may be cleared; 0: now. */
uint32_t tact_board_locked_ticks(const tact_board *board);

/* Whether the board stays in OFF until its faults are acknowledged. */
int tact_board_is_locked(const tact_board *board);

/* A reference within comfort, its slow part within the travel. */
float tact_board_limit(tact_board *board, int32_t channel, float want);

/* The command at zero and no transition under way. */
int tact_board_is_at_rest(const tact_board *board);

/* Whether a step would wait for the stream. */
int tact_board_waits(const tact_board *board);

/* Nothing is asked for in this tick: a row of zeros, limited as any reference is. */
void tact_board_ask(tact_board *board, float *wants);

/* count samples (rows) for the ticks from `first` on; gives the tick up to which samples are there now. What was there
 * stays; what does not follow on is left out. References are reshaped by their strength, where
 * the image says so, and limited to comfort and travel here, where they come in. */
uint32_t tact_board_stream(tact_board *board, uint32_t first, const float *rows, uint32_t count);

/* Whether samples of the stimulus are due. Outside of the interrupt: for as long as they are, make a row (which takes
 * its time), and put it in (which must not be interrupted; what is late only moves the limits on). */
int tact_board_wants_tones(const tact_board *board);
void tact_board_make_tones(tact_board *board, float *row);
void tact_board_take_tones(tact_board *board, const float *row);

/* The three together, where there is no interrupt. */
void tact_board_give_tones(tact_board *board);

/* New table or image, only in OFF: 1 if taken. */
int tact_board_take_safety(tact_board *board, const tact_safety *safety);
int tact_board_take_image(tact_board *board, const tact_image *image);

#endif
