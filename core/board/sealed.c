#include "board/sealed.h"

#include "wire/bytes.h"
#include "wire/crc32.h"

enum { LEAST = 16 };

int32_t tact_sealed_check(const tact_sealed_kind *kind, const uint8_t *bytes, size_t size)
{
    tact_reader reader = {bytes, size, 0, 0};
    const uint32_t magic = tact_read_u32(&reader);
    const uint32_t version = tact_read_u16(&reader);
    (void)tact_read_u16(&reader);
    const uint32_t length = tact_read_u32(&reader);
    if (reader.overrun)
        return TACT_SEALED_TRUNCATED;
    if (magic != kind->magic)
        return TACT_SEALED_NOT_ONE;
    if (version != kind->version)
        return TACT_SEALED_VERSION;
    if (length != size || length > kind->most || length < LEAST)
        return TACT_SEALED_TRUNCATED;
    reader.at = size - 4;
    return tact_read_u32(&reader) == tact_crc32(0, bytes, size - 4) ? TACT_SEALED_WHOLE : TACT_SEALED_CHECKSUM;
}
