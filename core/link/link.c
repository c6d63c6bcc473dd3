#include "link/link.h"

#include "board/run.h"
#include "wire/bytes.h"
#include "wire/crc32.h"
#include "link/report.h"

enum { ROWS_AT_ONCE = 4 };

static uint32_t keep_out(const tact_link *link)
{
    return link->enter ? link->enter() : 0;
}

static void let_in(const tact_link *link, uint32_t before)
{
    if (link->leave)
        link->leave(before);
}

void tact_link_reset(tact_link *link, tact_board *board, const char *name)
{
    uint8_t *bytes = (uint8_t *)link;
    for (size_t i = 0; i < sizeof *link; i++)
        bytes[i] = 0;
    link->board = board;
    for (int i = 0; i < TACT_BOARD_NAME_SIZE - 1 && name[i] != 0; i++)
        link->name[i] = (uint8_t)name[i];
    link->cobs.buffer = link->received;
    link->cobs.capacity = sizeof link->received;
    link->cobs.done = 1;
}

int32_t tact_link_missing(const tact_link *link)
{
    return link->missing ? link->missing() : 0;
}

/* -- what the board is given --------------------------------------------------------------------------------------- */

static int32_t take_upload(tact_link *link, tact_reader *in)
{
    const uint8_t kind = tact_read_u8(in);
    const uint32_t offset = tact_read_u32(in);
    const size_t size = in->overrun ? 0 : in->size - in->at;
    if (in->overrun || offset > TACT_UPLOAD_SIZE || size > TACT_UPLOAD_SIZE - offset)
        return TACT_BAD_PAYLOAD;
    link->upload_kind = kind;
    tact_read_bytes(in, link->upload + offset, size);
    return TACT_DONE;
}

static int32_t commit_image(tact_link *link, uint32_t size, uint8_t *refusal)
{
    tact_board *board = link->board;
    const tact_safety *safety = &board->safety;
    if (safety->channels == 0)
        return TACT_NOT_IN_THIS_MODE;
    *refusal = (uint8_t)tact_image_parse(&link->image, link->upload, size, safety->rate_hz, safety->delay_samples,
                                         safety->channels);
    if (*refusal)
        return TACT_REFUSED;
    const uint32_t before = keep_out(link);
    const int taken = tact_board_take_image(board, &link->image);
    let_in(link, before);
    return taken ? TACT_DONE : TACT_NOT_IN_THIS_MODE;
}

static int32_t commit_safety(tact_link *link, uint32_t size, uint8_t *refusal)
{
    tact_board *board = link->board;
    *refusal = (uint8_t)tact_safety_parse(&link->safety, link->upload, size, board->channels_max);
    if (*refusal)
        return TACT_REFUSED;
    const uint32_t before = keep_out(link);
    const int taken = tact_board_take_safety(board, &link->safety);
    let_in(link, before);
    return taken ? TACT_DONE : TACT_NOT_IN_THIS_MODE;
}

static int32_t commit_display(tact_link *link, uint32_t size, uint8_t *refusal)
{
    int taken = 0;
    if (!link->display.take)
        return TACT_NOT_HERE;
    const uint32_t before = keep_out(link);
    if (link->board->mode == TACT_OFF)
        taken = link->display.take(link->display.context, link->upload, size, link->board->channels);
    for (int32_t c = 0; taken && c < link->board->channels; c++)
        tact_guard_reset(&link->board->channel[c].guard, link->board->ticks); /* what it saw last was another display */
    let_in(link, before);
    *refusal = (uint8_t)!taken;
    return taken ? TACT_DONE : TACT_REFUSED;
}

static int32_t commit(tact_link *link, tact_reader *in, tact_writer *out)
{
    const tact_board *board = link->board;
    const uint8_t kind = tact_read_u8(in);
    const uint32_t size = tact_read_u32(in), crc = tact_read_u32(in);
    uint8_t refusal = 0;
    int32_t outcome = TACT_BAD_PAYLOAD;
    if (in->overrun || in->at != in->size || size < 4 || size > TACT_UPLOAD_SIZE)
        return TACT_BAD_PAYLOAD;
    if ((kind == TACT_UPLOAD_IMAGE && board->image.channels && board->image.crc == crc) ||
        (kind == TACT_UPLOAD_SAFETY && board->safety.channels && board->safety.crc == crc)) {
        outcome = TACT_DONE; /* this very one is there already */
    } else if (board->mode != TACT_OFF) {
        outcome = TACT_NOT_IN_THIS_MODE;
    } else if (kind != link->upload_kind || tact_crc32(0, link->upload, size - 4) != crc) {
        outcome = TACT_BAD_PAYLOAD; /* something of it has not arrived */
    } else if (kind == TACT_UPLOAD_IMAGE) {
        outcome = commit_image(link, size, &refusal);
    } else if (kind == TACT_UPLOAD_SAFETY) {
        outcome = commit_safety(link, size, &refusal);
    } else if (kind == TACT_UPLOAD_DISPLAY) {
        outcome = commit_display(link, size, &refusal);
    }
    tact_write_u8(out, refusal);
    return outcome;
}

static uint32_t take_rows(tact_link *link, tact_reader *in, uint32_t first, uint32_t count, int forces)
{
    tact_board *board = link->board;
    const uint32_t width = (uint32_t)board->channels;
    float rows[ROWS_AT_ONCE * TACT_CHANNELS_MAX];
    uint32_t end = board->stream_end;
    for (uint32_t k = 0; k < count; k += ROWS_AT_ONCE) {
        const uint32_t some = count - k < ROWS_AT_ONCE ? count - k : ROWS_AT_ONCE;
        if (k && first + k != end && first + k - end < 0x80000000u)
            break; /* what came before was too late; what follows would leave an unreported gap */
        for (uint32_t i = 0; i < some; i++) {
            for (uint32_t c = 0; c < width; c++)
                rows[i * width + c] = tact_read_f32(in);
            for (uint32_t c = 0; c < width && link->display.take; c++) {
                const float force_v = forces ? tact_read_f32(in) : 0.0f;
                const uint32_t row = (first + k + i) & (board->stream_capacity - 1);
                if (first + k + i >= board->stream_end)
                    link->display.force_v[row * width + c] = force_v;
            }
        }
        const uint32_t before = keep_out(link);
        end = tact_board_stream(board, first + k, rows, some);
        let_in(link, before);
    }
    return end;
}

static int32_t take_stream(tact_link *link, tact_reader *in, tact_writer *out)
{
    tact_board *board = link->board;
    const uint32_t run = tact_read_u32(in), first = tact_read_u32(in);
    uint32_t count = tact_read_u16(in);
    const uint32_t forces = tact_read_u8(in);
    const uint32_t row_size = (uint32_t)board->channels * (forces ? 8u : 4u);
    if (in->overrun || in->size - in->at != (size_t)count * row_size || (forces && !link->display.take))
        return TACT_BAD_PAYLOAD;
    if (run != board->run)
        return TACT_OTHER_RUN;
    if (board->mode != TACT_RUNNING || board->source != TACT_STREAM)
        return TACT_NOT_IN_THIS_MODE;
    const uint32_t room = board->stream_capacity - (first - board->tick);
    if (first - board->tick > board->stream_capacity)
        count = first - board->tick >= 0x80000000u ? count : 0; /* begins in the past, or too far ahead */
    else if (count > room)
        count = room;
    tact_write_u32(out, take_rows(link, in, first, count, forces != 0));
    tact_write_u32(out, board->tick);
    return TACT_DONE;
}

static int32_t take_stimulus(tact_link *link, tact_reader *in)
{
    tact_board *board = link->board;
    const uint32_t channel = tact_read_u8(in), count = tact_read_u8(in);
    tact_stimulus stimulus;
    if (in->overrun || channel >= (uint32_t)board->channels || count > TACT_TONES_MAX)
        return TACT_BAD_PAYLOAD;
    stimulus.count = (int32_t)count;
    for (uint32_t i = 0; i < count; i++) {
        tact_tone *tone = &stimulus.tone[i];
        tone->start = tact_read_u32(in);
        tone->length = tact_read_u32(in);
        tone->ramp = tact_read_u32(in);
        tone->amplitude = tact_read_f32(in);
        tone->cosine = tact_read_f32(in);
        tone->sine = tact_read_f32(in);
        tone->ramp_cosine = tact_read_f32(in);
        tone->ramp_sine = tact_read_f32(in);
        if (in->overrun || !tact_tone_is_valid(tone))
            return TACT_BAD_PAYLOAD;
    }
    if (in->at != in->size)
        return TACT_BAD_PAYLOAD;
    if (board->mode == TACT_RUNNING || board->mode == TACT_FAULT)
        return TACT_NOT_IN_THIS_MODE;
    tact_stimulus_rewind(&stimulus);
    board->stimulus[channel] = stimulus; /* read by nobody before a start */
    return TACT_DONE;
}

/* -- transitions ---------------------------------------------------------------------------------------------------- */

static int32_t start(tact_link *link, tact_reader *in)
{
    const uint32_t run = tact_read_u32(in);
    const int32_t source = tact_read_u8(in), drives = tact_read_u8(in), holds = tact_read_u8(in);
    if (in->overrun || in->at != in->size || source > TACT_STIMULUS || drives > 1 || holds > 1)
        return TACT_BAD_PAYLOAD;
    return tact_board_start(link->board, run, source, drives, holds) ? TACT_DONE : TACT_NOT_IN_THIS_MODE;
}

static int32_t acknowledge(tact_board *board, tact_reader *in)
{
    const uint32_t count = tact_read_u32(in);
    if (in->overrun || in->at != in->size || !tact_board_acknowledge(board, count))
        return TACT_BAD_PAYLOAD;
    return TACT_DONE;
}

static int32_t arm(const tact_link *link, tact_reader *in)
{
    tact_board *board = link->board;
    const int bare = in->at != in->size && tact_read_u8(in) == 1;
    if (in->overrun || in->at != in->size)
        return TACT_BAD_PAYLOAD;
    if (board->mode == TACT_OFF)
        board->bare = bare;
    if (!board->bare && tact_link_missing(link))
        return TACT_INCOMPLETE;
    if (tact_board_arm(board))
        return TACT_DONE;
    return board->mode == TACT_OFF && tact_board_is_locked(board) ? TACT_LOCKED : TACT_NOT_IN_THIS_MODE;
}

static int32_t move(tact_link *link, uint8_t type, tact_reader *in, tact_writer *out)
{
    tact_board *board = link->board;
    int32_t outcome;
    const uint32_t before = keep_out(link);
    if (type == TACT_ASK_START)
        outcome = start(link, in);
    else if (type == TACT_ASK_ACKNOWLEDGE)
        outcome = acknowledge(board, in);
    else if (type == TACT_ASK_ARM)
        outcome = arm(link, in);
    else if (in->size != in->at)
        outcome = TACT_BAD_PAYLOAD;
    else {
        const int done = type == TACT_ASK_STOP  ? tact_board_stop(board)
                         : type == TACT_ASK_OFF ? tact_board_off(board)
                                                : tact_board_clear(board);
        const int locked = type == TACT_ASK_CLEAR && tact_board_locked_ticks(board) != 0;
        outcome = done ? TACT_DONE : locked ? TACT_LOCKED : TACT_NOT_IN_THIS_MODE;
    }
    let_in(link, before);
    tact_write_u8(out, (uint8_t)board->mode);
    return outcome;
}

/* -- requests -------------------------------------------------------------------------------------------------------- */

static int32_t carry_out(tact_link *link, const tact_frame *frame, tact_writer *out)
{
    tact_reader in = {frame->payload, frame->size, 0, 0};
    if (frame->version != TACT_LINK_VERSION)
        return TACT_OTHER_VERSION;
    link->board->silence = 0;
    switch (frame->type) {
    case TACT_ASK_STATUS:
        return tact_report_status(link, out);
    case TACT_ASK_UPLOAD:
        return take_upload(link, &in);
    case TACT_ASK_COMMIT:
        return commit(link, &in, out);
    case TACT_ASK_ARM:
    case TACT_ASK_START:
    case TACT_ASK_STOP:
    case TACT_ASK_OFF:
    case TACT_ASK_CLEAR:
    case TACT_ASK_ACKNOWLEDGE:
        return move(link, frame->type, &in, out);
    case TACT_ASK_STREAM:
        return take_stream(link, &in, out);
    case TACT_ASK_STIMULUS:
        return take_stimulus(link, &in);
    case TACT_ASK_TRACE:
        return tact_report_trace(link, &in, out);
    case TACT_ASK_WEIGHTS:
        return tact_report_weights(link, &in, out);
    case TACT_ASK_TOUCH:
    case TACT_ASK_BREAK:
        return link->display.take ? link->display.request(link->display.context, frame->type, &in) : TACT_NOT_HERE;
    default:
        return TACT_UNKNOWN_REQUEST;
    }
}

int tact_link_receive(tact_link *link, uint8_t byte)
{
    tact_frame frame;
    link->wire_size = 0;
    const int whole = tact_cobs_receive(&link->cobs, byte);
    if (whole == 0)
        return 0;
    if (whole < 0 || !tact_frame_parse(&frame, link->received, link->cobs.length) || frame.type & TACT_ANSWER) {
        link->dropped++;
        return 0;
    }
    link->heard++;
    tact_writer out = {link->frame + 4, TACT_PAYLOAD_MAX, 1, 0};
    const int32_t outcome = carry_out(link, &frame, &out);
    out.bytes[0] = (uint8_t)(out.overrun ? TACT_BAD_PAYLOAD : outcome);
    const size_t size = tact_frame_seal(link->frame, frame.type | TACT_ANSWER, frame.sequence, out.at);
    link->wire_size = tact_cobs_encode(link->frame, size, link->wire, sizeof link->wire);
    return link->wire_size != 0;
}

size_t tact_link_serve(tact_link *link, const uint8_t *bytes, size_t size, uint8_t *answers, size_t capacity)
{
    size_t at = 0;
    for (size_t i = 0; i < size; i++)
        if (tact_link_receive(link, bytes[i]) && link->wire_size <= capacity - at)
            for (size_t j = 0; j < link->wire_size; j++)
                answers[at++] = link->wire[j];
    return at;
}
