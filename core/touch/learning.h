/* Weights of a finger, learnt on line from command and position. One channel.
 *
 * The weights are learnt: what the motor was given (u) less what the reading says of it (y through the plant's inverse)
 * is the finger's force. Both, and the pushes, pass the same three poles; slow parts are taken off; a hum of known
 * frequencies is estimated beside it. Least squares on the pushes, which carry no noise, forget the faster the more
 * there is to learn from. They count every turn by its own level: in speech what was loud would else outweigh, for as
 * long as it is remembered, what follows it. They lean towards the designed finger's shape, and are kept within bounds
 * and a slew. Below the gate nothing is learnt, and the weights fade to zero.
 * A weight that is no number sets everything to zero.
 */
#ifndef TACT_TOUCH_LEARNING_H
#define TACT_TOUCH_LEARNING_H

#include "touch/table.h"

/* One turn of learning: the state's weights move. Call in every `turns`-th sample (feed_forward.h does). */
void tact_touch_learn(const tact_touch *table, tact_touch_state *state);

#endif
