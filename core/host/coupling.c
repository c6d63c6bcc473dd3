#include "host/coupling.h"

typedef void step_function(tact_closed_loop *loops, int channels, const double *input, const double *force_v,
                           const tact_trace *trace, size_t samples);

/* What every channel feels of the frame at this instant, and of what presses it. */
static void forces(const tact_coupling *frame, int channels, const double *pressed_v, double *force_v)
{
    double arrived[TACT_COUPLING_CHANNELS_MAX], total = 0.0;
    for (int c = 0; c < channels; c++) {
        arrived[c] = tact_plant_output(TACT_COUPLING_ORDER, frame->path.sensor, frame->x[c]);
        total += arrived[c];
    }
    for (int c = 0; c < channels; c++)
        force_v[c] = (pressed_v ? pressed_v[c] : 0.0) + frame->share * (total - arrived[c]);
}

static tact_trace row_of(const tact_trace *trace, size_t at)
{
    const tact_trace row = {
        trace->command_v ? trace->command_v + at : NULL,
        trace->position_v ? trace->position_v + at : NULL,
        trace->displacement_mm ? trace->displacement_mm + at : NULL,
        trace->saturated ? trace->saturated + at : NULL,
        trace->broken ? trace->broken + at : NULL,
    };
    return row;
}

static void run(step_function *step, tact_coupling *frame, tact_closed_loop *loops, int channels, const double *input,
                const double *force_v, const tact_trace *trace, size_t samples)
{
    if (channels > TACT_COUPLING_CHANNELS_MAX)
        return;
    for (size_t k = 0; k < samples; k++) {
        const size_t at = k * (size_t)channels;
        const tact_trace row = row_of(trace, at);
        double acting_v[TACT_COUPLING_CHANNELS_MAX];
        forces(frame, channels, force_v ? force_v + at : NULL, acting_v);
        step(loops, channels, input + at, acting_v, &row, 1);
        for (int c = 0; c < channels; c++) {
            const double motor_v = loops[c].display_state.motor_v;
            tact_plant_step(TACT_COUPLING_ORDER, &frame->path, frame->x[c], motor_v, motor_v, 0.0);
        }
    }
}

void tact_coupled_play(tact_coupling *frame, tact_closed_loop *loops, int channels, const double *reference,
                     const double *force_v, const tact_trace *trace, size_t samples)
{
    run(tact_closed_loop_play, frame, loops, channels, reference, force_v, trace, samples);
}

void tact_coupled_drive(tact_coupling *frame, tact_closed_loop *loops, int channels, const double *command_v,
                      const double *force_v, const tact_trace *trace, size_t samples)
{
    run(tact_closed_loop_drive, frame, loops, channels, command_v, force_v, trace, samples);
}
