/* Whatever bytes come over the link: nothing is written out of bounds, and nothing but a whole, checked frame changes
 * the board. libFuzzer; built and run by test_link_fuzz.py and by hand for longer. */
#include <stdlib.h>
#include <string.h>

#include "wire/crc32.h"
#include "display/simulated_board.h"
#include "link/link.h"
#include "board/period.h"

enum { CHANNELS = 3, ROWS = 64 };

static tact_board board;
static tact_simulated_board simulated;
static tact_link link_under_test;
static float stream[ROWS * CHANNELS], force[ROWS * CHANNELS], felt_mm[ROWS * CHANNELS];
static int32_t trace[ROWS * CHANNELS * 2];

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static uint32_t number_at(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

static void put_number(uint8_t *bytes, uint32_t number)
{
    for (int i = 0; i < 4; i++)
        bytes[i] = (uint8_t)(number >> 8 * i);
}

/* A commit that names no checksum gets the right one, and so does what is to be committed. */
static void seal_upload(uint8_t *commit)
{
    const uint32_t size = number_at(commit + 1);
    if (number_at(commit + 5) != 0 || size < 4 || size > TACT_UPLOAD_SIZE)
        return;
    const uint32_t crc = tact_crc32(0, link_under_test.upload, size - 4);
    put_number(link_under_test.upload + size - 4, crc);
    put_number(commit + 5, crc);
}

/* Input: pairs of a length and as many bytes of a frame's content, which is sealed before it is sent, so that the
 * fuzzer gets past the checksums; a length of 255 sends what follows as it is. test_link_fuzz.py writes some. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static uint8_t content[TACT_FRAME_MAX], wire[TACT_WIRE_MAX];
    size_t at = 0;
    tact_board_reset(&board, CHANNELS, stream, ROWS, trace, ROWS);
    tact_simulated_board_reset(&simulated, force, felt_mm);
    tact_link_reset(&link_under_test, &board, "fuzzed");
    tact_simulated_board_join(&simulated, &link_under_test);
    board.allows_hold = 1;
    while (at + 3 < size) {
        const size_t length = data[at];
        const size_t left = size - at - 1;
        if (length == 255) {
            for (size_t i = at + 1; i < size; i++)
                (void)tact_link_receive(&link_under_test, data[i]);
            break;
        }
        const size_t payload = length < left - 1 ? length : left - 1;
        const uint8_t type = data[at + 1];
        memcpy(content + 4, data + at + 2, payload);
        if (type == TACT_ASK_COMMIT && payload == 9)
            seal_upload(content + 4);
        const size_t sealed = tact_frame_seal(content, type, 1, payload);
        const size_t encoded = tact_cobs_encode(content, sealed, wire, sizeof wire);
        for (size_t i = 0; i < encoded; i++)
            (void)tact_link_receive(&link_under_test, wire[i]);
        (void)tact_simulated_board_run(&simulated, &board, 4);
        at += 2 + payload;
    }
    if (board.mode != TACT_OFF && board.safety.channels == 0)
        abort();
    return 0;
}
