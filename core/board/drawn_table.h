/* Tables for checks: a board's own safety table and image, altered by draw, each time in another way.
 *
 *     table, image --> times short, delays, turns, limits tight or wide, converters --> table, image of an episode
 *                      gains, fewer sections, other forms
 *
 * So that a check comes by every limit and every form of a controller within few ticks, whatever was loaded.
 *
 * Example use:
 *   tact_drawn_safety(&safety, &board->safety, &noise);
 *   tact_drawn_image(&image, &board->image, &noise);
 */
#ifndef TACT_DRAWN_TABLE_H
#define TACT_DRAWN_TABLE_H

#include "arithmetic/noise.h"
#include "board/image.h"
#include "board/safety.h"

/* Within [0, 1), 24 bits. */
float tact_drawn_share(tact_noise *noise);

/* One of 0 ... count - 1. */
uint32_t tact_drawn_of(tact_noise *noise, uint32_t count);

void tact_drawn_safety(tact_safety *safety, const tact_safety *from, tact_noise *noise);
void tact_drawn_image(tact_image *image, const tact_image *from, tact_noise *noise);

#endif
