#include "wire/bytes.h"

uint8_t tact_read_u8(tact_reader *reader)
{
    if (reader->overrun || reader->at >= reader->size) {
        reader->overrun = 1;
        return 0;
    }
    return reader->bytes[reader->at++];
}

uint16_t tact_read_u16(tact_reader *reader)
{
    const uint32_t low = tact_read_u8(reader);
    return (uint16_t)(low | (uint32_t)tact_read_u8(reader) << 8);
}

uint32_t tact_read_u32(tact_reader *reader)
{
    const uint32_t low = tact_read_u16(reader);
    return low | (uint32_t)tact_read_u16(reader) << 16;
}

int32_t tact_read_i32(tact_reader *reader)
{
    const union {
        uint32_t bits;
        int32_t value;
    } both = {tact_read_u32(reader)};
    return both.value;
}

float tact_read_f32(tact_reader *reader)
{
    const union {
        uint32_t bits;
        float value;
    } both = {tact_read_u32(reader)};
    return both.value;
}

double tact_read_f64(tact_reader *reader)
{
    union {
        uint64_t bits;
        double value;
    } both;
    const uint64_t low = tact_read_u32(reader);
    both.bits = low | (uint64_t)tact_read_u32(reader) << 32;
    return both.value;
}

void tact_read_bytes(tact_reader *reader, uint8_t *into, size_t count)
{
    for (size_t i = 0; i < count; i++)
        into[i] = tact_read_u8(reader);
}

void tact_write_u8(tact_writer *writer, uint8_t value)
{
    if (writer->overrun || writer->at >= writer->size) {
        writer->overrun = 1;
        return;
    }
    writer->bytes[writer->at++] = value;
}

void tact_write_u16(tact_writer *writer, uint16_t value)
{
    tact_write_u8(writer, (uint8_t)(value & 0xffu));
    tact_write_u8(writer, (uint8_t)(value >> 8));
}

void tact_write_u32(tact_writer *writer, uint32_t value)
{
    tact_write_u16(writer, (uint16_t)(value & 0xffffu));
    tact_write_u16(writer, (uint16_t)(value >> 16));
}

void tact_write_f32(tact_writer *writer, float value)
{
    union {
        float value;
        uint32_t bits;
    } both;
    both.value = value;
    tact_write_u32(writer, both.bits);
}

int tact_is_number(float value)
{
    return value - value == 0.0f;
}
