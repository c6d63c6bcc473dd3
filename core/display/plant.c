#include "display/plant.h"

extern inline double tact_plant_output(int32_t order, const double *row, const double *x);
extern inline void tact_plant_step(int32_t order, const tact_plant *plant, double *x, double input_v, double before_v,
                                   double disturbance_v);
