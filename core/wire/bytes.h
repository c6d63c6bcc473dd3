/* Little-endian numbers out of and into bytes, never beyond their end.
 *
 *     |1f|00|00|00|...      A reader that would pass the end latches `overrun` and gives zeros from there on, so that a
 *      ^at        ^size     parser may read all its fields and ask once.
 *
 * Example use:
 *   tact_reader reader = {bytes, size, 0, 0};
 *   uint32_t magic = tact_read_u32(&reader);
 *   if (reader.overrun) refuse();
 */
#ifndef TACT_BYTES_H
#define TACT_BYTES_H

#include <stddef.h>
#include <stdint.h>

typedef struct {
    const uint8_t *bytes;
    size_t size;
    size_t at;
    int32_t overrun;
} tact_reader;

typedef struct {
    uint8_t *bytes;
    size_t size;
    size_t at;
    int32_t overrun;
} tact_writer;

uint8_t tact_read_u8(tact_reader *reader);
uint16_t tact_read_u16(tact_reader *reader);
uint32_t tact_read_u32(tact_reader *reader);
int32_t tact_read_i32(tact_reader *reader);
float tact_read_f32(tact_reader *reader);
double tact_read_f64(tact_reader *reader);
/* count bytes into `into`. */
void tact_read_bytes(tact_reader *reader, uint8_t *into, size_t count);

void tact_write_u8(tact_writer *writer, uint8_t value);
void tact_write_u16(tact_writer *writer, uint16_t value);
void tact_write_u32(tact_writer *writer, uint32_t value);
void tact_write_f32(tact_writer *writer, float value);

/* 1 for a number, 0 for NaN and infinities. */
int tact_is_number(float value);

#endif
