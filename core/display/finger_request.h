/* A finger put on the simulated display, or taken off it, and a sensor made to fail: requests that come over the link. */
#ifndef TACT_FINGER_REQUEST_H
#define TACT_FINGER_REQUEST_H

#include "display/simulated_board.h"
#include "wire/bytes.h"

/* Answers TACT_ASK_TOUCH and TACT_ASK_BREAK with a status of the link; context: the simulated board. */
int32_t tact_simulated_board_touch(void *context, uint8_t type, tact_reader *in);

#endif
