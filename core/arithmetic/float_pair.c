#include "arithmetic/float_pair.h"

extern inline tact_float_pair tact_float_pair_get(const void *at);
extern inline void tact_float_pair_copy(void *to, const void *from);
