/* The kernel for vectors of 512 bits. No fused multiply-add: -ffp-contract=off holds here too. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(TACT_LANES_BASELINE_ONLY)
#pragma GCC optimize("O3")
#pragma GCC target("avx512f,avx512vl,avx512dq,avx512bw,prefer-vector-width=512")

#define TACT_LANES_KERNEL tact_lanes_run_avx512
#include "lanes/lanes_kernel.inc"
#else
typedef int tact_lanes_avx512_is_not_for_this_processor;
#endif
