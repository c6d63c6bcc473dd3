/* The kernel for vectors of 256 bits. No fused multiply-add: -ffp-contract=off holds here too. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(TACT_LANES_BASELINE_ONLY)
#pragma GCC optimize("O3")
#pragma GCC target("avx2")

#define TACT_LANES_KERNEL tact_lanes_run_avx2
#include "lanes/lanes_kernel.inc"
#else
typedef int tact_lanes_avx2_is_not_for_this_processor;
#endif
