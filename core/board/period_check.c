#include "board/period_check.h"

#include "board/drawn_table.h"
#include "board/period.h"
#include "board/run.h"
#include "wire/bytes.h"

enum { KINDS = 10 };

static float of_bits(uint32_t bits)
{
    const union {
        uint32_t bits;
        float value;
    } both = {bits};
    return both.value;
}

static uint32_t bits_of(float value)
{
    union {
        float value;
        uint32_t bits;
    } both;
    both.value = value;
    return both.bits;
}

static void digest(tact_period_check *check, uint32_t word)
{
    const uint32_t so_far = check->result.digest;
    check->result.digest = (tact_noise_rotate(so_far, 5) ^ word) * 0x9E3779B1u;
}

/* A NaN's bits differ between processors, and say nothing. */
static void digest_float(tact_period_check *check, float value)
{
    digest(check, tact_is_number(value) ? bits_of(value) : 1u);
}

/* -- what is asked ------------------------------------------------------------------------------------------------- */

static float drawn_reference(tact_period_check *check, int32_t c)
{
    tact_noise *noise = &check->noise;
    const uint32_t bits = tact_noise_bits(noise);
    const float level = check->level[c], before = check->want[c];
    const float uniform = (float)((int32_t)(bits >> 8) - 8388608) * (1.0f / 8388608.0f);
    switch (check->kind) {
    case 0:
        return level * uniform;
    case 1: /* now and then from one side to the other */
        return (bits & 127u) == 0 ? (before > 0.0f ? -level : level) : before;
    case 2: /* wandering */
        return before + 0.02f * level * uniform;
    case 3: /* silence of either sign */
        return bits & 0x80000000u ? 0.0f : -0.0f;
    case 4: /* any number at all, NaN and infinities among them */
        return of_bits(bits);
    case 5: /* subnormal */
        return of_bits(bits & 0x807fffffu);
    case 6: /* just above and below what is taken for zero */
        return of_bits(0x0da24260u + (bits & 255u) - 128u);
    case 7:
        return bits & 1u ? level : -level;
    case 8:
        return (bits & 1023u) == 0 ? of_bits(0x7fc00000u) : before;
    default: /* a triangle */
        return before + (bits & 255u ? 0.01f : -1.0f) * level;
    }
}

static void give_stream(tact_period_check *check)
{
    tact_board *board = &check->board;
    float rows[4 * TACT_CHANNELS_MAX];
    const uint32_t width = (uint32_t)board->channels, how = tact_drawn_of(&check->noise, 64);
    if (board->source != TACT_STREAM || board->stream_end - board->tick - 1u < TACT_CHECK_AHEAD)
        return;
    if (how == 0) /* dry for a while */
        return;
    for (uint32_t i = 0; i < 4; i++)
        for (uint32_t c = 0; c < width; c++)
            rows[i * width + c] = check->want[c] = drawn_reference(check, (int32_t)c);
    const uint32_t first = how == 1 ? board->tick + 2u : how == 2 ? board->tick - 1u : board->stream_end;
    const uint32_t times = how == 3 ? TACT_CHECK_ROWS / 4u : 1u; /* more than the ring has room for */
    for (uint32_t i = 0; i < times; i++)
        digest(check, tact_board_stream(board, first + 4u * i, rows, 4));
}

/* A tone whose turn for a tick, and whose ramp's, are rational points of the circle. */
static tact_tone drawn_tone(tact_period_check *check)
{
    tact_noise *noise = &check->noise;
    const float t = tact_drawn_share(noise) * tact_drawn_share(noise), r = 0.01f + 0.1f * tact_drawn_share(noise);
    const uint32_t length = 2u + tact_drawn_of(noise, 400);
    const tact_tone tone = {
        tact_drawn_of(noise, 64), length, tact_drawn_of(noise, length / 2u + 1u),
        check->board.safety.channel[0].reference_max * 2.0f * tact_drawn_share(noise),
        (1.0f - t * t) / (1.0f + t * t), 2.0f * t / (1.0f + t * t),
        (1.0f - r * r) / (1.0f + r * r), 2.0f * r / (1.0f + r * r),
    };
    return tone;
}

static void give_stimulus(tact_period_check *check)
{
    for (int32_t c = 0; c < check->board.channels; c++) {
        tact_stimulus *stimulus = &check->board.stimulus[c];
        stimulus->count = (int32_t)tact_drawn_of(&check->noise, 4);
        for (int32_t i = 0; i < stimulus->count; i++) {
            stimulus->tone[i] = drawn_tone(check);
            digest(check, (uint32_t)tact_tone_is_valid(&stimulus->tone[i]));
        }
    }
}

/* -- what happens -------------------------------------------------------------------------------------------------- */

static void new_stretch(tact_period_check *check)
{
    tact_noise *noise = &check->noise;
    const tact_board *board = &check->board;
    check->event_left = 8u + tact_drawn_of(noise, 200);
    check->kind = tact_drawn_of(noise, KINDS);
    for (int32_t c = 0; c < board->channels; c++) {
        const float most = board->drives ? board->safety.channel[c].command_max_v
                                         : board->safety.channel[c].reference_max;
        const uint32_t halvings = tact_drawn_of(noise, 12);
        check->level[c] = 2.0f * (most < 2000.0f ? most : 2000.0f);
        for (uint32_t i = 0; i < halvings; i++)
            check->level[c] *= 0.5f;
    }
    check->is_silent = tact_drawn_of(noise, 24) == 0;
    check->is_late = tact_drawn_of(noise, 12) == 0;
    if (tact_drawn_of(noise, 3) == 0)
        tact_drawn_event(&check->display, &check->safety, noise);
}

static void start(tact_period_check *check)
{
    tact_board *board = &check->board;
    static const int32_t SOURCES[8] = {TACT_STREAM, TACT_STREAM,   TACT_STREAM,   TACT_STREAM,
                                       TACT_STREAM, TACT_STIMULUS, TACT_STIMULUS, TACT_SILENT};
    const uint32_t source = tact_drawn_of(&check->noise, 8);
    const int32_t drives = tact_drawn_of(&check->noise, 6) == 0;
    give_stimulus(check);
    const uint32_t ahead = tact_drawn_of(&check->noise, 32);
    const uint32_t run = ahead == 0 ? board->run - 1u : ahead == 1 ? board->run + (1u << 20) : board->run + ahead - 1u;
    const int begun = tact_board_start(board, run, SOURCES[source], drives, 0);
    check->result.starts += (uint32_t)begun;
    digest(check, (uint32_t)begun);
}

/* Another table and another image, as they are uploaded in OFF. */
static void swap(tact_period_check *check, const tact_board *like)
{
    tact_board *board = &check->board;
    const uint32_t kind = tact_drawn_of(&check->noise, 4);
    if (kind == 0 || board->safety.channels == 0) {
        tact_drawn_safety(&check->safety, &like->safety, &check->noise);
        digest(check, (uint32_t)tact_board_take_safety(board, &check->safety));
        tact_drawn_rest(&check->display);
    }
    if (kind < 3) {
        tact_drawn_image(&check->image, &like->image, &check->noise);
        digest(check, (uint32_t)tact_board_take_image(board, &check->image));
    }
}

/* What a host asks of a board in its mode; at times what it should not. */
static void transition(tact_period_check *check, const tact_board *like)
{
    tact_board *board = &check->board;
    const uint32_t ask = tact_drawn_of(&check->noise, 1024);
    if (ask > 8 && board->mode == TACT_RUNNING)
        return;
    if (board->mode == TACT_OFF && ask > 512)
        swap(check, like);
    if (ask < 2)
        digest(check, (uint32_t)tact_board_off(board));
    else if (tact_board_is_locked(board) && ask < 32)
        digest(check, (uint32_t)tact_board_acknowledge(board, board->sensor_faults + (ask & 1u)));
    else if (board->mode == TACT_OFF)
        digest(check, (uint32_t)tact_board_arm(board));
    else if (board->mode == TACT_ARMED && ask < 900)
        start(check);
    else if (board->mode == TACT_ARMED)
        digest(check, (uint32_t)tact_board_off(board));
    else if (board->mode == TACT_RUNNING)
        digest(check, (uint32_t)tact_board_stop(board));
    else
        digest(check, (uint32_t)tact_board_clear(board));
}

/* -- what is seen -------------------------------------------------------------------------------------------------- */

static void digest_controller(tact_period_check *check, const tact_controller_state *state)
{
    for (int32_t i = 0; i < TACT_PREFILTER_MAX + TACT_FEEDBACK_MAX; i++) {
        const int32_t at = i < TACT_PREFILTER_MAX ? i : i - TACT_PREFILTER_MAX;
        const tact_section_state *one = i == at ? &state->prefilter[at] : &state->feedback[at];
        digest_float(check, one->s1);
        digest_float(check, one->s2);
    }
}

static void digest_touch(tact_period_check *check, const tact_touch_state *touch)
{
    for (int i = 0; i < 2; i++) {
        digest_float(check, touch->weight[i]);
        digest_float(check, touch->model[i + 1]);
        digest_float(check, touch->product[i]);
    }
    digest_float(check, touch->plant.s1);
    digest_float(check, touch->balance[1]);
    digest_float(check, touch->balance[2]);
}

static void digest_guard(tact_period_check *check, const tact_guard_state *guard)
{
    digest_float(check, guard->x);
    digest_float(check, guard->w);
    digest_float(check, guard->agreement);
    digest_float(check, guard->power);
    digest_float(check, guard->strayed);
    digest_float(check, guard->straying);
    digest_float(check, guard->apart[0]);
    for (int32_t i = 0; i < TACT_WEIGHTING_COUNT; i++) {
        digest_float(check, guard->weighting[i].s1);
        digest_float(check, guard->weighting[i].s2);
    }
    digest(check, guard->changed_tick ^ (uint32_t)guard->last_code << 16);
}

/* What has not come out yet, of one channel after another. */
static void look_inside(tact_period_check *check)
{
    const tact_board *board = &check->board;
    const uint32_t c = board->ticks % (uint32_t)board->channels;
    const tact_board_channel *channel = &board->channel[c];
    digest_float(check, channel->delayed_v[board->delay_at]);
    digest_float(check, channel->slow);
    digest(check, tact_board_locked_ticks(board));
    if ((board->ticks & 3u) == 0 && board->image.channels != 0) {
        digest_guard(check, &channel->guard);
        digest_controller(check, &channel->controller);
        if (board->image.controller[c].touch.delay)
            digest_touch(check, &channel->controller.touch);
    }
}

static void look(tact_period_check *check, const int32_t *codes, uint32_t tick_before)
{
    const tact_board *board = &check->board;
    const uint32_t row = tick_before & (board->trace_capacity - 1), width = 2u * (uint32_t)board->channels;
    for (int32_t c = 0; c < board->channels; c++)
        digest(check, (uint32_t)codes[c]);
    digest(check, (uint32_t)(board->mode | board->fault << 4 | (board->fault_channel & 15) << 8 | board->ending << 12));
    digest(check, board->late ^ board->fault_tick << 8);
    digest(check, bits_of(board->fade) ^ tact_noise_rotate(bits_of(board->command_fade), 16));
    for (uint32_t i = 0; i < width && board->tick != tick_before; i++)
        digest(check, (uint32_t)board->trace[row * width + i]);
    look_inside(check);
    if (board->mode == TACT_RUNNING || (board->mode == TACT_FAULT && board->command_fade > 0.0f))
        check->result.running++;
    if (board->mode == TACT_FAULT)
        check->result.faults |= 1u << board->fault;
}

static void tick(tact_period_check *check)
{
    tact_board *board = &check->board;
    int32_t out[TACT_CHANNELS_MAX], in[TACT_CHANNELS_MAX];
    const uint32_t before = board->tick;
    const uint32_t late = check->is_late ? tact_drawn_of(&check->noise, 300) : 0;
    if (!check->is_silent)
        board->silence = 0;
    tact_board_give_tones(board);
    tact_period_latch(board, out);
    tact_drawn_codes(&check->display, &check->safety, out, in, &check->noise);
    tact_period_step(board, in, late * late / 600u);
    look(check, out, before);
}

tact_period_check_result tact_period_check_run(tact_period_check *check, const tact_board *like, uint32_t seed,
                                               uint32_t ticks)
{
    tact_board *board = &check->board;
    tact_board_reset(board, like->channels, check->stream, TACT_CHECK_ROWS, check->trace, TACT_CHECK_ROWS);
    tact_noise_seed(&check->noise, seed, 0);
    check->result = (tact_period_check_result){seed, 0, 0, 0};
    check->event_left = 0;
    for (int32_t c = 0; c < TACT_CHANNELS_MAX; c++)
        check->level[c] = check->want[c] = 0.0f;
    tact_drawn_rest(&check->display);
    while (board->safety.channels == 0)
        swap(check, like);
    for (uint32_t k = 0; k < ticks; k++) {
        if (check->event_left-- == 0)
            new_stretch(check);
        transition(check, like);
        if (board->mode == TACT_RUNNING)
            give_stream(check);
        tick(check);
    }
    return check->result;
}
