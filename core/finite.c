#include "finite.h"

extern inline float tact_finite(float x, float limit);
extern inline double tact_finite_double(double x, double limit);
