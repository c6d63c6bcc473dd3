/* Link: requests from the host, carried out on the board, each answered.
 *
 *     bytes --> COBS --> frame --> request --> board --> answer --> frame --> COBS --> bytes
 *
 * Every request may be sent, lost and come again: uploads name their place, a commit names the checksum of the whole,
 * a run has a number that only grows, samples of a stream and rows of a trace have the tick of the run. What is
 * uploaded lies aside until its commit has been checked whole; a table or an image is taken only in OFF.
 *
 *     request            payload                                              answer, after the tact_outcome
 *     STATUS             -                                                    tact_link_status()
 *     UPLOAD             kind u8, offset u32, bytes                           -
 *     COMMIT             kind u8, size u32, CRC-32 u32                        refusal u8 (tact_image_refusal, ...)
 *     ARM                bare u8, or nothing                                  mode u8
 *     STOP OFF CLEAR     -                                                    mode u8
 *     ACKNOWLEDGE        sensor faults u32                                    mode u8
 *     START              run u32, source u8, drives u8, holds u8              mode u8
 *     STREAM             run u32, first u32, count u16, forces u8, rows f32   end u32, tick u32
 *     STIMULUS           channel u8, count u8, tones                          -
 *     TRACE              run u32, first u32, count u16, felt u8               first u32, count u16, rows
 *     WEIGHTS            -                                                    tick of the run u32, 2 f32 a channel
 *     TOUCH              channel u8, load u8                                  -
 *     BREAK              channel u8, sensor u8, value f32                     -
 *
 * A board that lacks something refuses ARM, unless the run is to be bare: its outputs stay safe throughout.
 * TOUCH and BREAK are for boards whose display is simulated, which registers itself in `display`. Memory is bounded at
 * both ends: a frame is at most TACT_FRAME_MAX bytes, the stream and the trace are the board's rings.
 *
 * Example use:
 *   for each byte: tact_link_receive(&link, byte);      then send link.wire[0 .. link.wire_size), if any
 */
#ifndef TACT_LINK_H
#define TACT_LINK_H

#include <stddef.h>
#include <stdint.h>

#include "board/board.h"
#include "wire/cobs.h"
#include "wire/frame.h"
#include "wire/bytes.h"

typedef enum {
    TACT_ASK_STATUS = 1,
    TACT_ASK_UPLOAD,
    TACT_ASK_COMMIT,
    TACT_ASK_ARM = 0x10,
    TACT_ASK_START,
    TACT_ASK_STOP,
    TACT_ASK_OFF,
    TACT_ASK_CLEAR,
    TACT_ASK_ACKNOWLEDGE,
    TACT_ASK_STREAM = 0x20,
    TACT_ASK_STIMULUS,
    TACT_ASK_TRACE,
    TACT_ASK_WEIGHTS,
    TACT_ASK_TOUCH = 0x30,
    TACT_ASK_BREAK
} tact_request;

typedef enum {
    TACT_DONE = 0,
    TACT_UNKNOWN_REQUEST,
    TACT_OTHER_VERSION,
    TACT_BAD_PAYLOAD,
    TACT_NOT_IN_THIS_MODE,
    TACT_REFUSED,
    TACT_OTHER_RUN,
    TACT_NOT_HERE,
    TACT_LOCKED, /* after sensor or travel faults: board.h */
    TACT_INCOMPLETE /* something of the board is missing */
} tact_outcome;

enum { TACT_UPLOAD_IMAGE = 1, TACT_UPLOAD_SAFETY, TACT_UPLOAD_DISPLAY };
/* What a board may lack, as STATUS reports it. */
enum { TACT_MISSING_CRYSTAL = 1, TACT_MISSING_AD = 2, TACT_MISSING_DA = 4, TACT_MISSING_SUPPLY = 8, TACT_MISSING_WATCHDOG = 16 };
enum { TACT_UPLOAD_SIZE = 8192, TACT_BOARD_NAME_SIZE = 16 };

typedef struct tact_link tact_link;

/* What replaces a board's converters. `take` NULL: the converters are real. */
typedef struct {
    void *context;
    int (*take)(void *context, const uint8_t *bytes, size_t size, int32_t channels); /* an upload: 1 if it is taken */
    int32_t (*request)(void *context, uint8_t type, tact_reader *in); /* TOUCH or BREAK: the tact_outcome */
    float *force_v;                                                   /* ring beside the board's stream */
    const float *felt_mm;                                             /* ring beside the board's trace */
    const uint32_t *crc;                                              /* of what was taken; 0: nothing yet */
} tact_link_display;

struct tact_link {
    tact_board *board;
    tact_link_display display;
    /* Keeps the timer's interrupt out, and restores what was before; NULL without one. */
    uint32_t (*enter)(void);
    void (*leave)(uint32_t before);
    int32_t (*missing)(void); /* TACT_MISSING_... now; NULL where nothing can be */
    uint8_t name[TACT_BOARD_NAME_SIZE];
    tact_cobs cobs;
    uint32_t heard, dropped; /* whole frames; spoilt ones */
    int32_t upload_kind;
    tact_image image;   /* a candidate, until it has been checked */
    tact_safety safety;
    uint8_t received[TACT_FRAME_MAX];
    uint8_t upload[TACT_UPLOAD_SIZE];
    uint8_t frame[TACT_FRAME_MAX];
    uint8_t wire[TACT_WIRE_MAX]; /* the answer, to be sent */
    size_t wire_size;            /* 0: none */
};

/* What the board lacks now. */
int32_t tact_link_missing(const tact_link *link);

/* Without a frame yet. name: at most 15 characters. */
void tact_link_reset(tact_link *link, tact_board *board, const char *name);

/* One byte in; 1 when an answer lies in `wire`, to be sent before the next byte is given. */
int tact_link_receive(tact_link *link, uint8_t byte);

/* size bytes in; answers to all of them into `answers`, as far as they fit: how many bytes. */
size_t tact_link_serve(tact_link *link, const uint8_t *bytes, size_t size, uint8_t *answers, size_t capacity);

#endif
