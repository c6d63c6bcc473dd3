#include "display/hum.h"

void tact_hum_settle(const tact_hum *hum, tact_hum_state *state)
{
    for (int32_t i = 0; i < hum->count; i++) {
        const double c = state->cosine[i], s = state->sine[i];
        const double gain = 1.5 - 0.5 * (c * c + s * s);
        state->cosine[i] = c * gain;
        state->sine[i] = s * gain;
    }
    state->age = 0;
}
