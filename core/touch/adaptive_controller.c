#include "touch/adaptive_controller.h"

extern inline float tact_adaptive_step(const tact_controller *table, const tact_touch *touch,
                                       tact_controller_state *state, tact_touch_state *touch_state, float reference,
                                       float position_v);
