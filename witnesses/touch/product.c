/* The product's controller of one channel behind one function, for generator.c: core/ as it is, nothing of its own. */
#include <stddef.h>

#include "control/controller.h"

typedef struct {
    const tact_controller *table;
    tact_controller_state state;
} product;

size_t product_size(void)
{
    return sizeof(product);
}

void product_begin(product *p, const void *table)
{
    p->table = table;
    tact_controller_reset(p->table, &p->state);
}

float product_step(void *controller, float reference, float position_v)
{
    product *p = controller;
    const float asked = tact_finite(reference, TACT_REFERENCE_MAX);
    const float command_v = tact_controller_step(p->table, &p->state, asked, position_v);
    tact_controller_put(p->table, &p->state, command_v);
    return command_v;
}

void product_weights(const product *p, double *weights)
{
    weights[0] = (double)p->state.touch.weight[0];
    weights[1] = (double)p->state.touch.weight[1];
}

/* Puts `value` in place of one of the estimator's numbers; 0 where `at` is beyond the last. */
int product_spoil(product *p, size_t at, float value)
{
    const size_t counts = offsetof(tact_touch_state, at) / sizeof(float);
    const size_t place = at + (at >= counts ? 2 : 0);
    if (place >= sizeof(tact_touch_state) / sizeof(float))
        return 0;
    ((float *)(void *)&p->state.touch)[place] = value;
    return 1;
}
