/* Lawful play, counted: a simulated board plays whatever a reference may be, while fingers press, tap, tremble, come and
 * go. Its sensors are sound, so that every fault of a sensor is a false one; each is told with its moment.
 *
 *     seed --> tones, noise, steps, silence --> board --> simulated display <-- presses, taps, tremor, loads
 *
 *     lawful_play SEED SECONDS WHICH    tables.h, written by test_lying_sensor.py: designed tables and a display; WHICH of the
 *                                       controllers: 0 fixed, 1 adaptive
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "board/run.h"
#include "display/simulated_board.h"
#include "tables.h"

enum { ROWS = 256, BLOCK = 64, CHANNELS = 3, TONES = 3, LAST_KIND = 6 };

typedef struct {
    double cosine, sine, re, im;
} rotation;

typedef struct {
    int kind;
    float level, want;
    rotation tone[TONES];
    int tones;
    double push_v, pushed_v, force_v, per_tick; /* what the finger goes for; two low passes on the way to it */
    rotation tremor;
    double tap_v;
    int tap_ticks, tap_at;
} player;

static tact_board board;
static tact_simulated_board simulated;
static float stream[ROWS * CHANNELS], force[ROWS * CHANNELS], felt_mm[ROWS * CHANNELS];
static int32_t trace[ROWS * CHANNELS * 2];
static player players[CHANNELS];
static tact_noise noise;
static unsigned long long faults[TACT_FAULT_LAST + 1], ticks, running, starts;

static void check(int holds, const char *what)
{
    if (!holds) {
        fprintf(stderr, "lawful_play: %s\n", what);
        exit(2);
    }
}

static double part(void)
{
    return (double)(tact_noise_bits(&noise) >> 8) / 16777216.0;
}

static uint32_t one_of(uint32_t count)
{
    return (tact_noise_bits(&noise) >> 8) % count;
}

static double uniform(void)
{
    return 2.0 * part() - 1.0;
}

/* most, halved up to `halvings` times: as often small as large. */
static double spread(double most, uint32_t halvings)
{
    const double share = 0.5 + 0.5 * part();
    return most * share / (double)(1u << one_of(halvings + 1));
}

/* A rational point of the circle near that frequency. */
static rotation turning(double hertz, double amplitude)
{
    const double t = 3.14159265 * hertz / (double)board.safety.rate_hz;
    const rotation made = {(1.0 - t * t) / (1.0 + t * t), 2.0 * t / (1.0 + t * t), amplitude, 0.0};
    return made;
}

static double turn(rotation *r)
{
    const double re = r->cosine * r->re - r->sine * r->im;
    r->im = r->sine * r->re + r->cosine * r->im;
    r->re = re;
    return r->im;
}

static void draw_reference(player *p, float most)
{
    p->kind = (int)one_of(LAST_KIND + 1);
    p->level = (float)spread(1.0, 10) * most;
    p->want = 0.0f;
    if (p->kind == 4) /* a step across all that is allowed, with a finger's force at the worst moment, may be too far */
        p->level *= 0.5f;
    p->tones = p->kind < 3 ? 1 + (int)one_of(TONES) : 0;
    for (int i = 0; i < p->tones; i++)
        p->tone[i] = turning(spread(300.0, 9), p->level / (float)p->tones);
}

static void draw_finger(player *p)
{
    const uint32_t kind = one_of(8);
    const double sign = one_of(2) ? 1.0 : -1.0;
    p->push_v = kind < 3 ? 0.0 : sign * spread(0.7, 6);
    p->per_tick = 1.0 / spread(0.3 * (double)board.safety.rate_hz, 6); /* 2.5 to 300 ms, twice */
    p->tremor = turning(8.0 + 4.0 * part(), kind == 7 || kind == 2 ? spread(0.1, 4) : 0.0);
    if (one_of(4) == 0) {
        p->tap_v = sign * spread(0.7, 4);
        p->tap_ticks = 12 + (int)one_of(80);
        p->tap_at = 0;
    }
}

static float reference(player *p)
{
    double sum = 0.0;
    for (int i = 0; i < p->tones; i++)
        sum += turn(&p->tone[i]);
    if (p->kind == 3)
        sum = p->level * uniform();
    if (p->kind == 4) /* from one side to the other, now and then */
        sum = p->want = one_of(200) == 0 ? (p->want > 0.0f ? -p->level : p->level) : p->want;
    if (p->kind == 5) /* wandering */
        sum = p->want = 0.999f * p->want + 0.05f * p->level * (float)uniform();
    return (float)sum;
}

static float pressed(player *p)
{
    double tap_v = 0.0;
    p->pushed_v += p->per_tick * (p->push_v - p->pushed_v);
    p->force_v += p->per_tick * (p->pushed_v - p->force_v);
    if (p->tap_at < p->tap_ticks) {
        const double x = (double)p->tap_at++ / (double)p->tap_ticks;
        tap_v = 4.0 * x * (1.0 - x) * p->tap_v;
    }
    return (float)(p->force_v + tap_v + turn(&p->tremor));
}

static void draw_event(void)
{
    const uint32_t c = one_of(CHANNELS), kind = one_of(5);
    if (kind < 2)
        draw_reference(&players[c], board.safety.channel[c].reference_max);
    else if (kind < 4)
        draw_finger(&players[c]);
    else
        simulated.state[c].touched = (int32_t)one_of((uint32_t)simulated.table[c].plant_count);
}

/* From whatever is, back to a run. */
static void begin(void)
{
    (void)tact_board_acknowledge(&board, board.sensor_faults);
    (void)tact_board_clear(&board);
    (void)tact_board_arm(&board);
    starts += board.mode == TACT_ARMED && tact_board_start(&board, board.run + 1, TACT_STREAM, 0, 0);
}

static void play_block(void)
{
    float rows[BLOCK * CHANNELS];
    const uint32_t first = board.tick;
    for (int i = 0; i < BLOCK; i++)
        for (int c = 0; c < CHANNELS; c++) {
            const uint32_t row = (first + (uint32_t)i) & (ROWS - 1);
            rows[i * CHANNELS + c] = reference(&players[c]);
            force[row * CHANNELS + (uint32_t)c] = pressed(&players[c]);
        }
    (void)tact_board_stream(&board, first, rows, BLOCK);
    for (int i = 0; i < BLOCK; i++) {
        const int32_t before = board.mode;
        board.silence = 0;
        (void)tact_simulated_board_period(&simulated, &board, 0);
        ticks++;
        running += board.mode == TACT_RUNNING;
#ifdef WATCH
        WATCH
#endif
        if (board.mode == TACT_FAULT && before != TACT_FAULT) {
            if (faults[board.fault]++ < 3)
                printf("fault %d channel %d tick %llu kind %d level %.4g force %.4g touched %d\n", board.fault,
                       board.fault_channel, ticks, players[board.fault_channel].kind,
                       (double)players[board.fault_channel].level, players[board.fault_channel].force_v,
                       simulated.state[board.fault_channel].touched);
        }
    }
}

static void take_tables(unsigned long which)
{
    static const struct {
        const uint8_t *safety, *image;
        size_t safety_size, image_size;
    } FILES[] = {
        {SAFETY_FIXED, IMAGE_FIXED, sizeof SAFETY_FIXED, sizeof IMAGE_FIXED},
        {SAFETY_ADAPTIVE, IMAGE_ADAPTIVE, sizeof SAFETY_ADAPTIVE, sizeof IMAGE_ADAPTIVE},
    };
    static tact_safety safety;
    static tact_image image;
    check(which < sizeof FILES / sizeof *FILES, "allowed for WHICH: 0, 1");
    check(tact_safety_parse(&safety, FILES[which].safety, FILES[which].safety_size, CHANNELS) == TACT_SAFETY_GOOD,
          "safety table");
    check(tact_image_parse(&image, FILES[which].image, FILES[which].image_size, safety.rate_hz, 1, CHANNELS) == 0, "image");
    check(tact_simulated_board_parse(&simulated, DISPLAY, sizeof DISPLAY, CHANNELS), "display");
    check(tact_board_take_safety(&board, &safety) && tact_board_take_image(&board, &image), "tables not taken");
    check((board.image.controller[0].touch.delay > 0) == (which > 0), "finger fed forward");
}

int main(int count, char **arguments)
{
    check(count == 4, "allowed: lawful_play SEED SECONDS WHICH");
    tact_noise_seed(&noise, (uint32_t)strtoul(arguments[1], NULL, 10), 77);
    tact_board_reset(&board, CHANNELS, stream, ROWS, trace, ROWS);
    tact_simulated_board_reset(&simulated, force, felt_mm);
    take_tables(strtoul(arguments[3], NULL, 10));
    for (int c = 0; c < CHANNELS; c++)
        draw_reference(&players[c], 0.0f);
    const double wanted = strtod(arguments[2], NULL) * (double)board.safety.rate_hz;
    while ((double)ticks < wanted) {
        if (board.mode != TACT_RUNNING)
            begin();
        else if (one_of(600) == 0)
            (void)tact_board_stop(&board);
        if (one_of(6) == 0)
            draw_event();
        play_block();
    }
    printf("seconds %.6g running %.6g runs %llu", (double)ticks / (double)board.safety.rate_hz,
           (double)running / (double)board.safety.rate_hz, starts);
    for (int f = 1; f <= TACT_FAULT_LAST; f++)
        printf(" %llu", faults[f]);
    printf("\n");
#ifdef WATCH
    TELL
#endif
    return 0;
}
