/* Frames of the link: what travels between two zeros, once COBS is undone.
 *
 *     | version | type | sequence (2) | payload (0 to TACT_PAYLOAD_MAX) | CRC-32 of all before (4) |
 *
 * The board answers every whole frame with type | TACT_ANSWER, the same sequence, and a payload that begins with a
 * tact_outcome: a request may be sent again until its answer comes, since each of them may be carried out twice.
 *
 * Example use:
 *   tact_frame frame;
 *   if (tact_frame_parse(&frame, cobs.buffer, cobs.length)) answer(&frame);
 */
#ifndef TACT_FRAME_H
#define TACT_FRAME_H

#include <stddef.h>
#include <stdint.h>

enum { TACT_LINK_VERSION = 2, TACT_PAYLOAD_MAX = 4096, TACT_FRAME_OVERHEAD = 8 };
enum { TACT_FRAME_MAX = TACT_PAYLOAD_MAX + TACT_FRAME_OVERHEAD };
enum { TACT_WIRE_MAX = TACT_FRAME_MAX + TACT_FRAME_MAX / 254 + 2 };
enum { TACT_ANSWER = 0x80 };

typedef struct {
    uint8_t version;
    uint8_t type;
    uint16_t sequence;
    const uint8_t *payload;
    size_t size; /* of the payload */
} tact_frame;

/* 1 for a frame that is whole (of whatever version: its layout is kept), 0 for one to be dropped. */
int tact_frame_parse(tact_frame *frame, const uint8_t *bytes, size_t size);

/* Header before and checksum behind a payload that already lies at bytes + 4; the whole length. */
size_t tact_frame_seal(uint8_t *bytes, uint8_t type, uint16_t sequence, size_t payload_size);

#endif
