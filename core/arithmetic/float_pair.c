#include "arithmetic/float_pair.h"

extern inline tact_pair tact_pair_get(const void *at);
