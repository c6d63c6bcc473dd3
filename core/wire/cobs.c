#include "wire/cobs.h"

static void store(tact_cobs *cobs, uint8_t byte)
{
    if (cobs->length < cobs->capacity)
        cobs->buffer[cobs->length++] = byte;
    else
        cobs->spoilt = 1;
}

/* The zero between frames: what has come so far is a frame, nothing, or a spoilt one. */
static int finish(tact_cobs *cobs, int begun)
{
    const int whole = !cobs->spoilt && cobs->left == 0;
    cobs->left = cobs->adds_zero = cobs->spoilt = 0;
    cobs->done = 1;
    return !whole ? -1 : begun;
}

int tact_cobs_receive(tact_cobs *cobs, uint8_t byte)
{
    if (cobs->done && byte != 0)
        cobs->length = cobs->done = 0;
    if (byte == 0)
        return finish(cobs, !cobs->done);
    if (cobs->left != 0) {
        store(cobs, byte);
        cobs->left--;
        return 0;
    }
    if (cobs->adds_zero)
        store(cobs, 0);
    cobs->left = (uint8_t)(byte - 1);
    cobs->adds_zero = byte != 255;
    return 0;
}

size_t tact_cobs_encode(const uint8_t *bytes, size_t size, uint8_t *encoded, size_t capacity)
{
    if (capacity < size + size / 254 + 2)
        return 0;
    size_t code_at = 0, at = 1;
    uint8_t code = 1;
    for (size_t i = 0; i < size; i++) {
        if (bytes[i] != 0) {
            encoded[at++] = bytes[i];
            code++;
        }
        if (bytes[i] == 0 || code == 255) {
            encoded[code_at] = code;
            code = 1;
            code_at = at++;
        }
    }
    encoded[code_at] = code;
    encoded[at++] = 0;
    return at;
}
