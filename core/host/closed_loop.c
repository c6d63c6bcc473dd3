#include "host/closed_loop.h"

void tact_closed_loop_rest(tact_closed_loop *loop)
{
    if (loop->controller)
        tact_controller_reset(loop->controller, &loop->controller_state);
    tact_strength_reset(&loop->strength_state);
    loop->delay_at = 0;
    for (int i = 0; i < TACT_DELAY_MAX; i++) {
        loop->delayed_code[i] = loop->display->converter.rest_code;
        loop->delayed_flags[i] = 0;
    }
}

static int at_rail(const tact_converter *converter, int32_t code)
{
    return (code <= converter->code_min) | (code >= converter->code_max);
}

static void record(const tact_trace *trace, size_t at, const tact_closed_loop *loop, double command_v, int32_t reading,
                   int flags)
{
    const tact_converter *converter = &loop->display->converter;
    if (trace->command_v)
        trace->command_v[at] = command_v;
    if (trace->position_v)
        trace->position_v[at] = (double)tact_converter_position_v(converter, reading);
    if (trace->displacement_mm)
        trace->displacement_mm[at] = loop->display_state.displacement_mm;
    if (trace->saturated)
        trace->saturated[at] = (uint8_t)(((flags & TACT_SATURATED_COMMAND) != 0) | at_rail(converter, reading));
    if (trace->broken)
        trace->broken[at] = (flags & TACT_BROKEN) != 0;
}

/* The controller's answer to a reading: a code, and what became of it. */
static inline int32_t answer(tact_closed_loop *loop, float reference, int32_t reading, int32_t *flags)
{
    const tact_converter *converter = &loop->display->converter;
    tact_controller_state *state = &loop->controller_state;
    const float position_v = tact_converter_position_v(converter, reading);
    const float command_v = tact_controller_step(loop->controller, state, reference, position_v);
    const int32_t code = tact_converter_code(converter, command_v);
    tact_controller_put(loop->controller, state, command_v);
    *flags = (state->clamped | at_rail(converter, code) ? TACT_SATURATED_COMMAND : 0) | (state->broken ? TACT_BROKEN : 0);
    return code;
}

static inline void play_sample(int32_t order, tact_closed_loop *loop, float reference, double force_v,
                               const tact_trace *trace, size_t at)
{
    const tact_display *display = loop->display;
    tact_display_state *state = &loop->display_state;
    int32_t flags, reading;
    double command_v;
    if (loop->delay_samples == 0) {
        reading = tact_display_read_order(order, display, state);
        const int32_t code = answer(loop, reference, reading, &flags);
        command_v = tact_display_latch(display, state, code, force_v);
    } else {
        const int32_t slot = loop->delay_at;
        flags = loop->delayed_flags[slot];
        command_v = tact_display_latch(display, state, loop->delayed_code[slot], force_v);
        reading = tact_display_read_order(order, display, state);
        loop->delayed_code[slot] = answer(loop, reference, reading, &loop->delayed_flags[slot]);
        loop->delay_at = slot + 1 < loop->delay_samples ? slot + 1 : 0;
    }
    record(trace, at, loop, command_v, reading, flags);
    tact_display_advance_order(order, display, state);
}

static inline void drive_sample(int32_t order, tact_closed_loop *loop, float command_v, double force_v,
                                const tact_trace *trace, size_t at)
{
    const tact_converter *converter = &loop->display->converter;
    const int32_t code = tact_converter_code(converter, tact_finite(command_v, 1e6f));
    const double put_out_v = tact_display_latch(loop->display, &loop->display_state, code, force_v);
    const int32_t reading = tact_display_read_order(order, loop->display, &loop->display_state);
    record(trace, at, loop, put_out_v, reading, at_rail(converter, code) ? TACT_SATURATED_COMMAND : 0);
    tact_display_advance_order(order, loop->display, &loop->display_state);
}

static float wanted(tact_closed_loop *loop, double reference)
{
    const float asked = (float)reference;
    const int reshapes = loop->strength->is_on;
    return tact_finite(reshapes ? tact_strength_step(loop->strength, &loop->strength_state, asked) : asked, TACT_REFERENCE_MAX);
}

static int32_t order_of(const tact_closed_loop *loop)
{
    return tact_display_plant(loop->display, &loop->display_state)->order;
}

void tact_closed_loop_play(tact_closed_loop *loops, int channels, const double *reference, const double *force_v,
                           const tact_trace *trace, size_t samples)
{
    size_t at = 0;
    for (size_t k = 0; k < samples; k++)
        for (int c = 0; c < channels; c++, at++) {
            const int32_t order = order_of(&loops[c]);
            const double force = force_v ? force_v[at] : 0.0;
            if (order == 2)
                play_sample(2, &loops[c], wanted(&loops[c], reference[at]), force, trace, at);
            else
                play_sample(order, &loops[c], wanted(&loops[c], reference[at]), force, trace, at);
        }
}

void tact_closed_loop_drive(tact_closed_loop *loops, int channels, const double *command_v, const double *force_v,
                            const tact_trace *trace, size_t samples)
{
    for (int c = 0; c < channels; c++) {
        const int32_t order = order_of(&loops[c]);
        for (size_t k = 0; k < samples; k++) {
            const size_t at = k * (size_t)channels + (size_t)c;
            drive_sample(order, &loops[c], (float)command_v[at], force_v ? force_v[at] : 0.0, trace, at);
        }
    }
}
