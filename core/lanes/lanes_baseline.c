/* The kernel for whatever vectors every processor of this kind has (SSE2, NEON). */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("O3")
#endif

#define TACT_LANES_KERNEL tact_lanes_run_baseline
#include "lanes/lanes_kernel.inc"
