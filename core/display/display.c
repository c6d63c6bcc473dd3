#include "display/display.h"

void tact_display_reset(const tact_display *table, tact_display_state *state, uint32_t seed, uint32_t channel)
{
    state->touched = 0;
    state->dead_at = 0;
    for (int32_t i = 0; i < table->dead_time; i++)
        state->dead_time_v[i] = 0.0;
    for (int i = 0; i < TACT_ORDER_MAX; i++)
        state->x[i] = 0.0;
    state->motor_v = state->before_v = state->force_v = state->displacement_mm = 0.0;
    state->friction.force_v = state->friction.position = 0.0;
    for (int32_t i = 0; i < table->hum.count; i++) {
        state->hum.cosine[i] = 1.0;
        state->hum.sine[i] = 0.0;
    }
    state->hum.age = 0;
    tact_noise_seed(&state->noise, seed, channel);
}

int32_t tact_display_read(const tact_display *table, tact_display_state *state)
{
    const int32_t order = tact_display_plant(table, state)->order;
    return order == 2 ? tact_display_read_order(2, table, state) : tact_display_read_order(order, table, state);
}

void tact_display_advance(const tact_display *table, tact_display_state *state)
{
    const int32_t order = tact_display_plant(table, state)->order;
    if (order == 2)
        tact_display_advance_order(2, table, state);
    else
        tact_display_advance_order(order, table, state);
}
