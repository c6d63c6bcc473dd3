/* The path that runs in production, tact_period_step(), under whatever happens: readings, references, lateness, silence,
 * transitions and swapped tables by the bytes of an input. Aborts where an invariant of what is put out does not hold.
 *
 *     input: | operation | its bytes | operation | ...          tables.h, written by test_period_fuzz.py: designed tables
 *                                                               and drawn ones, and a display
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "board/period.h"
#include "board/run.h"
#include "display/simulated_board.h"

typedef struct {
    const uint8_t *bytes;
    size_t size;
    int32_t delay; /* samples, of an image */
} file;

#include "tables.h"

enum { ROWS = 64, CHANNELS = 3, USUAL = 3, IMAGES = sizeof IMAGE_FILES / sizeof *IMAGE_FILES };
enum { SAFETIES = sizeof SAFETY_FILES / sizeof *SAFETY_FILES };
enum { CLEAR, ARM, START, STOP, OFF, ACKNOWLEDGE, STREAM, RUN, NOISE, SILENT, LATE, IMAGE, SAFETY, TONES, EVENT, RAW };

typedef struct {
    const uint8_t *bytes;
    size_t left;
} input;

static tact_board board;
static tact_simulated_board display;
static float force[ROWS * CHANNELS], felt_mm[ROWS * CHANNELS];
static tact_noise noise;
static tact_safety safeties[SAFETIES];
static tact_image images[IMAGES];
static float stream[ROWS * CHANNELS];
static int32_t trace[ROWS * CHANNELS * 2];
static uint32_t resting, fading;
static unsigned long long steps;

int LLVMFuzzerInitialize(int *count, char ***arguments);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define MUST(what)                                                                                                     \
    do {                                                                                                               \
        if (!(what)) {                                                                                                 \
            fprintf(stderr, "does not hold: %s\n", #what);                                                             \
            abort();                                                                                                   \
        }                                                                                                              \
    } while (0)

static void tell(void)
{
    fprintf(stderr, "steps of the period: %llu\n", steps);
}

int LLVMFuzzerInitialize(int *count, char ***arguments)
{
    (void)count;
    (void)arguments;
    for (size_t i = 0; i < SAFETIES; i++)
        MUST(tact_safety_parse(&safeties[i], SAFETY_FILES[i].bytes, SAFETY_FILES[i].size, CHANNELS) == TACT_SAFETY_GOOD);
    for (size_t i = 0; i < IMAGES; i++)
        MUST(tact_image_parse(&images[i], IMAGE_FILES[i].bytes, IMAGE_FILES[i].size, safeties[0].rate_hz,
                              IMAGE_FILES[i].delay, CHANNELS) == 0);
    atexit(tell);
    return 0;
}

static uint32_t one_of(uint32_t count)
{
    return (tact_noise_bits(&noise) >> 8) % count;
}

static float share(void)
{
    return (float)(tact_noise_bits(&noise) >> 8) * (1.0f / 16777216.0f);
}

static uint8_t next(input *in)
{
    if (in->left == 0)
        return 0;
    in->left--;
    return *in->bytes++;
}

/* What is put out, before anything else happens. */
static void judge_codes(const int32_t *codes)
{
    for (int32_t c = 0; c < board.safety.channels; c++) {
        const tact_board_channel *channel = &board.channel[c];
        const tact_converter *converter = &board.safety.channel[c].converter;
        MUST(codes[c] >= converter->code_min && codes[c] <= converter->code_max);
        MUST(!channel->is_cut || codes[c] == converter->rest_code);
        MUST(resting <= (uint32_t)board.safety.delay_samples || codes[c] == converter->rest_code);
    }
}

static void judge_board(int32_t mode_before)
{
    const tact_safety *table = &board.safety;
    MUST(board.fade >= 0.0f && board.fade <= 1.0f && board.command_fade >= 0.0f && board.command_fade <= 1.0f);
    MUST(mode_before != TACT_FAULT || board.mode == TACT_FAULT);
    MUST(board.mode != TACT_FAULT || board.fault != TACT_FAULT_NONE);
    MUST(tact_board_is_at_rest(&board) == (board.mode != TACT_RUNNING &&
                                           !(board.mode == TACT_FAULT && board.command_fade > 0.0f)));
    for (int32_t c = 0; c < table->channels; c++) {
        const tact_board_channel *channel = &board.channel[c];
        for (int32_t d = 0; d < table->delay_samples; d++)
            MUST(fabsf(channel->delayed_v[d]) <= table->channel[c].command_max_v);
        MUST(board.drives || board.mode != TACT_RUNNING || fabsf(channel->slow) <= table->channel[c].travel_max * 1.001f + 1e-3f);
    }
    resting = board.mode == TACT_OFF || board.mode == TACT_ARMED ? resting + 1 : 0;
    fading = board.mode == TACT_FAULT && board.command_fade > 0.0f ? fading + 1 : 0;
    MUST(fading <= (uint32_t)(table->fade_ticks + table->ramp_ticks + table->quick_ticks + table->soft_start_ticks) + 8u);
}

static void tick(uint32_t lateness, int heard, int noisy)
{
    int32_t out[TACT_CHANNELS_MAX] = {0}, in[TACT_CHANNELS_MAX] = {0};
    const int32_t before = board.mode;
    if (heard)
        board.silence = 0;
    if (heard)
        tact_board_give_tones(&board);
    if (tact_board_waits(&board)) { /* its port takes no step until rows come, or the run is stopped */
        MUST(board.holds && board.mode == TACT_RUNNING && board.source == TACT_STREAM);
        return;
    }
    tact_period_latch(&board, out);
    judge_codes(out);
    tact_simulated_board_latch(&display, out);
    tact_simulated_board_read(&display, in);
    tact_simulated_board_advance(&display);
    for (int c = 0; noisy && c < board.channels; c++)
        in[c] = (int32_t)tact_noise_bits(&noise) >> 16;
    tact_period_step(&board, in, lateness);
    judge_board(before);
    steps++;
}

static void give_rows(input *in, int raw)
{
    float rows[16 * CHANNELS];
    const float level = ldexpf(1.0f, (int)(next(in) % 24) - 8);
    const uint8_t kind = next(in);
    for (int i = 0; i < 16 * CHANNELS; i++) {
        const uint32_t bits = raw ? (uint32_t)next(in) << 24 | (uint32_t)next(in) << 16 : tact_noise_bits(&noise);
        const union {
            uint32_t bits;
            float value;
        } any = {bits};
        rows[i] = raw ? any.value : kind & 1 ? level : kind & 2 ? level * (share() - 0.5f) : 0.0f;
    }
    const uint32_t first = kind & 4 ? board.tick + 1 : kind & 8 ? board.tick - 3 : board.stream_end;
    (void)tact_board_stream(&board, first, rows, 16);
    for (uint32_t t = board.tick; board.mode == TACT_RUNNING && !board.drives && board.stream_end - t - 1 < ROWS; t++)
        for (int c = 0; c < board.channels; c++)
            MUST(t - board.stream_at >= board.stream_end - board.stream_at ||
                 fabsf(stream[(t & (ROWS - 1)) * (uint32_t)board.channels + (uint32_t)c]) <=
                     board.safety.channel[c].reference_max);
}

static void give_tones(input *in)
{
    for (int c = 0; c < board.channels && board.mode != TACT_RUNNING; c++) {
        const float t = (float)next(in) / 512.0f, r = 0.05f;
        const uint32_t length = 2u + next(in);
        const tact_tone tone = {next(in), length, length / 3u, 4.0f * (float)next(in),
                                (1.0f - t * t) / (1.0f + t * t), 2.0f * t / (1.0f + t * t),
                                (1.0f - r * r) / (1.0f + r * r), 2.0f * r / (1.0f + r * r)};
        board.stimulus[c].count = 1;
        board.stimulus[c].tone[0] = tone;
    }
}

/* Transitions, tables: what a host asks for. */
static void ask(input *in, uint8_t operation)
{
    const uint8_t byte = next(in);
    const uint32_t locked = tact_board_locked_ticks(&board);
    const int32_t before = board.mode;
    if (operation == CLEAR)
        MUST(!tact_board_clear(&board) || before != TACT_FAULT || locked == 0);
    else if (operation == ARM)
        MUST(!tact_board_arm(&board) || before != TACT_OFF || !tact_board_is_locked(&board));
    else if (operation == START)
        (void)tact_board_start(&board, board.run + (byte & 32 ? 0u : 1u + (byte >> 6)), byte % 3,
                               byte >> 2 & byte >> 3 & 1, byte >> 4 & 1);
    else if (operation == STOP)
        (void)tact_board_stop(&board);
    else if (operation == OFF)
        (void)tact_board_off(&board);
    else if (operation == ACKNOWLEDGE)
        (void)tact_board_acknowledge(&board, board.sensor_faults + (byte & 1u));
    else if (operation == IMAGE) {
        (void)(board.safety.channels && tact_board_take_image(&board, &images[byte & 128 ? one_of(IMAGES) : byte % USUAL]));
    } else if (operation == SAFETY) {
        if (tact_board_take_safety(&board, &safeties[byte & 1 ? one_of(SAFETIES) : 0]))
            resting = 0;
    }
}

/* A channel is touched, pressed or let go, or its sensor begins to lie or is mended. */
static void happen(void)
{
    const uint32_t c = one_of(CHANNELS), kind = one_of(8);
    if (kind < 4)
        display.state[c].touched = (int32_t)(kind & 1);
    else if (kind < 6)
        display.force_v[c] = 4.0f * (share() - 0.5f);
    else
        tact_sensor_fault_set(&display.sensor[c], (int32_t)one_of(TACT_SENSOR_LAST + 1), share(), display.code[c]);
}

static void act(input *in, uint8_t operation)
{
    const uint32_t count = operation == RUN || operation == SILENT ? 4u * next(in) : operation >= RUN ? next(in) : 0;
    if (operation == STREAM || operation == RAW)
        give_rows(in, operation == RAW);
    else if (operation == TONES)
        give_tones(in);
    else if (operation == EVENT)
        happen();
    else if (operation == RUN || operation == NOISE || operation == SILENT)
        for (uint32_t k = 0; k < count; k++)
            tick(0, operation != SILENT, operation == NOISE);
    else if (operation == LATE)
        tick(2u * count, 1, 0);
    else
        ask(in, operation);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    input in = {data, size};
    tact_board_reset(&board, CHANNELS, stream, ROWS, trace, ROWS);
    tact_noise_seed(&noise, 1u + next(&in), 0);
    tact_simulated_board_reset(&display, force, felt_mm);
    MUST(tact_simulated_board_parse(&display, DISPLAY, sizeof DISPLAY, CHANNELS));
    resting = fading = 0;
    board.allows_hold = 1;
    tick(0, 1, 0); /* without a table */
    MUST(tact_board_take_safety(&board, &safeties[0]));
    MUST(tact_board_take_image(&board, &images[next(&in) % USUAL]));
    while (in.left)
        act(&in, next(&in) & 15);
    return 0;
}
