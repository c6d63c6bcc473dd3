#include "lanes/lanes_job.h"

extern inline void tact_metrics_add(tact_metrics *metrics, double displacement_mm, double command_v, int32_t flags,
                                    double sine, double cosine);

enum { CHUNK = 64 };

#if defined(TACT_LANES_WIDE)
int tact_lanes_available(int kernel)
{
    if (kernel == TACT_LANES_AVX2)
        return __builtin_cpu_supports("avx2");
    if (kernel == TACT_LANES_AVX512)
        return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
               __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
    return kernel >= TACT_LANES_WIDEST && kernel <= TACT_LANES_BASELINE;
}
#else
int tact_lanes_available(int kernel)
{
    return kernel >= TACT_LANES_WIDEST && kernel <= TACT_LANES_BASELINE;
}
#endif

static int widest(void)
{
    int kernel = TACT_LANES_AVX512;
    while (!tact_lanes_available(kernel))
        kernel--;
    return kernel;
}

static int are_alike(const tact_closed_loop *one, const tact_closed_loop *other)
{
    const tact_display *mine = one->display, *theirs = other->display;
    const tact_display_state *my_state = &one->display_state, *their_state = &other->display_state;
    return !other->touch && one->controller->prefilter_count == other->controller->prefilter_count &&
           one->controller->feedback_count == other->controller->feedback_count &&
           tact_display_plant(mine, my_state)->order == tact_display_plant(theirs, their_state)->order &&
           one->delay_samples == other->delay_samples && one->delay_at == other->delay_at &&
           mine->dead_time == theirs->dead_time && mine->has_late == theirs->has_late &&
           my_state->dead_at == their_state->dead_at && mine->hum.count == theirs->hum.count &&
           my_state->hum.age == their_state->hum.age;
}

static int is_batch(const tact_closed_loop *loops, size_t left)
{
    if (left < TACT_LANES || loops[0].touch)
        return 0;
    for (int l = 1; l < TACT_LANES; l++)
        if (!are_alike(&loops[0], &loops[l]))
            return 0;
    return 1;
}

/* One loop in chunks on the stack, its columns copied to and from the caller's arrays. */
static void run_single(const tact_lanes_job *job, tact_closed_loop *loop)
{
    double reference[CHUNK], force_v[CHUNK], command_v[CHUNK], position_v[CHUNK], displacement_mm[CHUNK];
    uint8_t saturated[CHUNK], broken[CHUNK];
    const tact_trace columns = {command_v, position_v, displacement_mm, saturated, broken};
    for (size_t k = 0; k < job->samples; k += CHUNK) {
        const size_t chunk = job->samples - k < CHUNK ? job->samples - k : CHUNK;
        for (size_t i = 0; i < chunk; i++) {
            const size_t at = (k + i) * job->count + job->first;
            reference[i] = job->reference_columns == 1 ? job->reference[k + i] : job->reference[at];
            force_v[i] = job->force_v ? job->force_v[at] : 0.0;
        }
        tact_closed_loop_play(loop, 1, reference, force_v, &columns, chunk);
        for (size_t i = 0; i < chunk; i++) {
            const size_t at = (k + i) * job->count + job->first;
            if (job->trace && job->trace->command_v)
                job->trace->command_v[at] = command_v[i];
            if (job->trace && job->trace->position_v)
                job->trace->position_v[at] = position_v[i];
            if (job->trace && job->trace->displacement_mm)
                job->trace->displacement_mm[at] = displacement_mm[i];
            if (job->trace && job->trace->saturated)
                job->trace->saturated[at] = saturated[i];
            if (job->trace && job->trace->broken)
                job->trace->broken[at] = broken[i];
            if (job->metrics)
                tact_metrics_add(&job->metrics[job->first], displacement_mm[i], command_v[i], saturated[i] | broken[i],
                                 job->probe ? job->probe->sine[k + i] : 0.0,
                                 job->probe ? job->probe->cosine[k + i] : 0.0);
        }
    }
}

static void run_batch(int kernel, const tact_lanes_job *job, tact_closed_loop *loops)
{
#if defined(TACT_LANES_WIDE)
    if (kernel == TACT_LANES_AVX512) {
        tact_lanes_run_avx512(job, loops);
        return;
    }
    if (kernel == TACT_LANES_AVX2) {
        tact_lanes_run_avx2(job, loops);
        return;
    }
#endif
    (void)kernel;
    tact_lanes_run_baseline(job, loops);
}

int tact_lanes_play(int kernel, tact_closed_loop *loops, size_t count, const double *reference,
                    size_t reference_columns, const double *force_v, const tact_trace *trace, tact_metrics *metrics,
                    const tact_probe *probe, size_t samples)
{
    tact_lanes_job job = {0, count, samples, reference, reference_columns, force_v, trace, metrics, probe};
    if (!tact_lanes_available(kernel))
        return 0;
    const int used = kernel == TACT_LANES_WIDEST ? widest() : kernel;
    while (job.first < count) {
        tact_closed_loop *at = loops + job.first;
        if (used != TACT_LANES_SINGLE && is_batch(at, count - job.first)) {
            run_batch(used, &job, at);
            job.first += TACT_LANES;
        } else {
            run_single(&job, at);
            job.first++;
        }
    }
    return used;
}
