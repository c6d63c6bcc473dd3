/* Job of a kernel: one batch of TACT_LANES loops and the places of its arrays, as lanes.c hands it over.
 *
 * Example use:
 *   const tact_lanes_job job = {...};
 *   tact_lanes_run_baseline(&job, loops + job.first);
 */
#ifndef TACT_LANES_JOB_H
#define TACT_LANES_JOB_H

#include "lanes/lanes.h"

/* Define TACT_LANES_BASELINE_ONLY to leave the wider kernels out. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(TACT_LANES_BASELINE_ONLY)
#define TACT_LANES_WIDE 1
#endif

typedef struct {
    size_t first, count, samples; /* first loop of the batch, loops in all */
    const double *reference;
    size_t reference_columns;
    const double *force_v;
    const tact_trace *trace;
    tact_metrics *metrics;
    const tact_probe *probe;
} tact_lanes_job;

/* One sample into the sums. */
inline void tact_metrics_add(tact_metrics *metrics, double displacement_mm, double command_v, int32_t flags,
                             double sine, double cosine)
{
    const double moved = displacement_mm < 0.0 ? -displacement_mm : displacement_mm;
    const double commanded = command_v < 0.0 ? -command_v : command_v;
    metrics->displacement_sum += displacement_mm;
    metrics->displacement_squares += displacement_mm * displacement_mm;
    metrics->displacement_peak_mm = moved > metrics->displacement_peak_mm ? moved : metrics->displacement_peak_mm;
    metrics->command_squares += command_v * command_v;
    metrics->command_peak_v = commanded > metrics->command_peak_v ? commanded : metrics->command_peak_v;
    metrics->in_phase += displacement_mm * sine;
    metrics->quadrature += displacement_mm * cosine;
    metrics->saturated += flags != 0;
}

/* The kernels: job->first names the batch, `loops` its first loop. */
void tact_lanes_run_baseline(const tact_lanes_job *job, tact_closed_loop *loops);
void tact_lanes_run_avx2(const tact_lanes_job *job, tact_closed_loop *loops);
void tact_lanes_run_avx512(const tact_lanes_job *job, tact_closed_loop *loops);

#endif
