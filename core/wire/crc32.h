/* CRC-32 (ISO-HDLC, as in zlib and Ethernet): reflected polynomial 0xEDB88320, sixteen-entry table.
 *
 * Finds every error of up to 3 bits in a frame of the link, and all but one in 2^32 of the others.
 *
 * Example use:
 *   uint32_t crc = tact_crc32(0, bytes, size);        crc = tact_crc32(crc, more, more_size);
 */
#ifndef TACT_CRC32_H
#define TACT_CRC32_H

#include <stddef.h>
#include <stdint.h>

/* The checksum of what `crc` was of, followed by these bytes; 0 to begin with. */
uint32_t tact_crc32(uint32_t crc, const uint8_t *bytes, size_t size);

#endif
