/* Tables as they come over the link, sealed: what an image and a safety table have in common.
 *
 *     magic u32 | version u16 | u16 | length u32 | the table's own | CRC-32 of all before
 *
 * Example use:
 *   const tact_sealed_kind kind = {TACT_IMAGE_MAGIC, TACT_IMAGE_VERSION, TACT_IMAGE_MAX};
 *   if (tact_sealed_check(&kind, bytes, size) == TACT_SEALED_WHOLE) read_the_rest();
 */
#ifndef TACT_SEALED_H
#define TACT_SEALED_H

#include <stddef.h>
#include <stdint.h>

/* The first refusals of a table, whichever it is: tact_image_refusal and tact_safety_refusal begin with them. */
enum { TACT_SEALED_WHOLE = 0, TACT_SEALED_TRUNCATED, TACT_SEALED_NOT_ONE, TACT_SEALED_VERSION, TACT_SEALED_CHECKSUM };

typedef struct {
    uint32_t magic;
    uint32_t version;
    size_t most; /* bytes */
} tact_sealed_kind;

/* What can be said of the bytes before their meaning is looked at: TACT_SEALED_WHOLE, or why not. */
int32_t tact_sealed_check(const tact_sealed_kind *kind, const uint8_t *bytes, size_t size);

#endif
