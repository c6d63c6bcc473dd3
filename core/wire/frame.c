#include "wire/frame.h"

#include "wire/bytes.h"
#include "wire/crc32.h"

int tact_frame_parse(tact_frame *frame, const uint8_t *bytes, size_t size)
{
    if (size < TACT_FRAME_OVERHEAD || size > TACT_FRAME_MAX)
        return 0;
    tact_reader reader = {bytes, size, size - 4, 0};
    if (tact_read_u32(&reader) != tact_crc32(0, bytes, size - 4))
        return 0;
    reader.at = 0;
    frame->version = tact_read_u8(&reader);
    frame->type = tact_read_u8(&reader);
    frame->sequence = tact_read_u16(&reader);
    frame->payload = bytes + 4;
    frame->size = size - TACT_FRAME_OVERHEAD;
    return 1;
}

size_t tact_frame_seal(uint8_t *bytes, uint8_t type, uint16_t sequence, size_t payload_size)
{
    tact_writer writer = {bytes, TACT_FRAME_MAX, 0, 0};
    tact_write_u8(&writer, TACT_LINK_VERSION);
    tact_write_u8(&writer, type);
    tact_write_u16(&writer, sequence);
    writer.at += payload_size;
    tact_write_u32(&writer, tact_crc32(0, bytes, writer.at));
    return writer.at;
}
