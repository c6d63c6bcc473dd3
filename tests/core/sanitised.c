/* The loops under the address and undefined-behaviour sanitisers: hostile references, forces and tables. */
#include <stdio.h>
#include <stdlib.h>

#include "arithmetic/noise.h"
#include "host/closed_loop.h"

enum { LOOPS = 37, SAMPLES = 300 };

static tact_noise dice;

static float hostile(void)
{
    union {
        uint32_t bits;
        float value;
    } any;
    any.bits = tact_noise_bits(&dice);
    const uint32_t kind = tact_noise_bits(&dice) & 7u;
    if (kind < 3u)
        return any.value;
    return (float)tact_noise_next(&dice) * 1e-3f;
}

static float within(float limit)
{
    return limit * (float)tact_noise_next(&dice) / 131070.0f;
}

static void make_controller(tact_controller *table, int unstable)
{
    table->prefilter_count = TACT_PREFILTER_MAX;
    table->feedback_count = TACT_FEEDBACK_MAX;
    for (int i = 0; i < TACT_PREFILTER_MAX + TACT_FEEDBACK_MAX; i++) {
        tact_section *section = i < TACT_PREFILTER_MAX ? &table->prefilter[i] : &table->feedback[i - TACT_PREFILTER_MAX];
        section->b0 = 1.0f;
        section->b1 = within(0.1f);
        section->b2 = within(0.01f);
        section->a1 = unstable ? within(3.0f) : 0.5f;
        section->a2 = unstable ? within(3.0f) : 0.06f;
    }
    table->anti_windup[0] = within(0.1f);
    table->anti_windup[1] = within(0.1f);
    table->command_max_v = 10.0f;
}

static void make_display(tact_display *display, tact_plant *plants, int order)
{
    for (int p = 0; p < 2; p++) {
        plants[p].order = order;
        for (int i = 0; i < order; i++) {
            plants[p].a[i][i] = 0.99;
            plants[p].b[i] = 0.01;
            plants[p].late[i] = 0.003;
            plants[p].sensor[i] = 1.0;
            plants[p].displacement[i] = 5.0;
        }
    }
    display->plants = plants;
    display->plant_count = 2;
    display->dead_time = TACT_DEAD_TIME_MAX - 1;
    display->has_late = 1;
    tact_converter_make(&display->converter, 24, 10.0, -1.0, 0.3);
    display->friction.stiffness = 0.4;
    display->friction.per_presliding = 100.0;
    display->sensor_v_per_mm = 0.2;
    display->noise_v = 1e-8;
    display->hum.count = TACT_HUM_MAX;
    for (int i = 0; i < TACT_HUM_MAX; i++) {
        display->hum.cosine[i] = 0.8;
        display->hum.sine[i] = 0.6;
        display->hum.amplitude_v[i] = 1e-3;
    }
}

static void run(int order, int unstable, int delay_samples)
{
    static tact_controller controller;
    static const tact_strength strength;
    static tact_display display;
    static tact_plant plants[2];
    static tact_closed_loop loops[LOOPS];
    static double reference[LOOPS * SAMPLES], force_v[LOOPS * SAMPLES], outputs[3][LOOPS * SAMPLES];
    static uint8_t flags[2][LOOPS * SAMPLES];
    make_controller(&controller, unstable);
    make_display(&display, plants, order);
    for (uint32_t i = 0; i < LOOPS; i++) {
        loops[i].controller = &controller;
        loops[i].strength = &strength;
        loops[i].display = &display;
        loops[i].delay_samples = delay_samples;
        tact_display_reset(&display, &loops[i].display_state, 1u, i);
        tact_closed_loop_rest(&loops[i]);
        loops[i].display_state.touched = (int32_t)(i & 1u);
    }
    for (int i = 0; i < LOOPS * SAMPLES; i++) {
        reference[i] = (double)hostile() * (i & 1 ? 1.0 : 1e30);
        force_v[i] = (double)hostile() * 1e30;
    }
    const tact_trace trace = {outputs[0], outputs[1], outputs[2], flags[0], flags[1]};
    tact_closed_loop_play(loops, LOOPS, reference, force_v, &trace, SAMPLES);
    tact_closed_loop_drive(loops, LOOPS, reference, force_v, &trace, SAMPLES);
    for (int i = 0; i < LOOPS * SAMPLES; i++)
        if (!(outputs[0][i] >= -21.0 && outputs[0][i] <= 21.0 && outputs[1][i] >= -10.0 && outputs[1][i] <= 10.0)) {
            fprintf(stderr, "sample %d: command %g, position %g\n", i, outputs[0][i], outputs[1][i]);
            exit(1);
        }
}

int main(void)
{
    tact_noise_seed(&dice, 7u, 7u);
    for (int unstable = 0; unstable < 2; unstable++) {
        run(2, unstable, 1);
        run(TACT_ORDER_MAX, unstable, TACT_DELAY_MAX);
        run(1, unstable, 0);
    }
    puts("sound");
    return 0;
}
