/* Many closed loops at once, one SIMD lane each: Monte Carlo work on the host.
 *
 *     loops    0   1   2  ...  15 | 16  17 ...        Sixteen loops make a batch: structure of arrays, every operation
 *            +---+---+---+   +---+                    of the single loop done in all lanes before the next. A loop's
 *   sample k |   |   |   |   |   |  one operation     lane computes what tact_closed_loop_play() would, bit for bit:
 *            +---+---+---+   +---+                    the same inline functions, the same order, no fused operation.
 *
 * The kernel is compiled several times for wider and wider vectors, and the widest that the processor has is chosen
 * at run time. A batch whose loops differ in structure (orders, numbers of sections, delays, lines of hum), and what
 * is left over behind the last batch, goes through the single loop.
 *
 * Example use:
 *   tact_lanes_play(TACT_LANES_WIDEST, loops, 1000, reference, 1, NULL, NULL, metrics, NULL, samples);
 */
#ifndef TACT_LANES_H
#define TACT_LANES_H

#include "display/closed_loop.h"

enum { TACT_LANES = 16 };

enum {
    TACT_LANES_WIDEST = 0,
    TACT_LANES_SINGLE = 1, /* the single loop, for comparison */
    TACT_LANES_BASELINE = 2,
    TACT_LANES_AVX2 = 3,
    TACT_LANES_AVX512 = 4
};

/* Sums over the samples of one loop. */
typedef struct {
    double displacement_sum, displacement_squares, displacement_peak_mm;
    double command_squares, command_peak_v;
    double in_phase, quadrature; /* sums of displacement times the probe's sine and cosine */
    int32_t saturated;           /* samples with any flag */
} tact_metrics;

/* Sine and cosine of a lock-in, one of each per sample, the same for every loop. */
typedef struct {
    const double *sine, *cosine;
} tact_probe;

/* Returns 1 if a kernel runs on this processor, 0 if not. */
int tact_lanes_available(int kernel);

/* samples through count loops. reference: (samples, reference_columns), reference_columns 1 (every loop gets the same)
 * or count; force_v (may be NULL): (samples, count). trace (may be NULL): as in closed_loop.h, (samples, count).
 * metrics (may be NULL): one for each loop, added to. probe (may be NULL). Gives the kernel used, or 0 if the one asked
 * for cannot run here. */
int tact_lanes_play(int kernel, tact_closed_loop *loops, size_t count, const double *reference,
                    size_t reference_columns, const double *force_v, const tact_trace *trace, tact_metrics *metrics,
                    const tact_probe *probe, size_t samples);

#endif
