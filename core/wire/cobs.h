/* Consistent overhead byte stuffing: frames without a zero byte inside, a zero byte between them.
 *
 *     11 22 00 33      ->   03 11 22 02 33 00       (Cheshire & Baker 1999, IEEE/ACM Trans. Networking 7, 159)
 *
 * At most one byte in 254 is added. A decoder that has lost its place finds it again at the next zero, whatever came
 * before: tact_cobs_receive() takes one byte at a time into a buffer of the caller's and says when a frame is whole.
 *
 * Example use:
 *   tact_cobs cobs = {buffer, sizeof buffer, 0, 0, 0, 0, 0};
 *   for each byte: if (tact_cobs_receive(&cobs, byte) > 0) handle(buffer, cobs.length);
 */
#ifndef TACT_COBS_H
#define TACT_COBS_H

#include <stddef.h>
#include <stdint.h>

typedef struct {
    uint8_t *buffer;
    size_t capacity;
    size_t length;    /* of the frame so far */
    uint8_t left;      /* bytes to come before the next code byte */
    uint8_t adds_zero; /* a zero lies between the block that ends and the next */
    uint8_t spoilt;    /* too long: wait for the zero */
    uint8_t done;      /* the frame has been handed out: the next byte begins another */
} tact_cobs;

/* 1: a frame of cobs->length bytes lies in the buffer until the next call. 0: not yet. -1: a spoilt one ended here. */
int tact_cobs_receive(tact_cobs *cobs, uint8_t byte);

/* size bytes as a frame with its zero at the end; its length, or 0 where `capacity` is too small. */
size_t tact_cobs_encode(const uint8_t *bytes, size_t size, uint8_t *encoded, size_t capacity);

#endif
