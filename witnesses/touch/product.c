/* The product's controller of one channel behind one function, for generator.c: core/ as it is, nothing of its own. */
#include "touch/adaptive_controller.h"

typedef struct {
    const tact_controller *table;
    const tact_touch *touch;
    tact_controller_state state;
    tact_touch_state touch_state;
} product;

size_t product_size(void)
{
    return sizeof(product);
}

void product_begin(product *p, const void *table, const void *touch)
{
    p->table = table;
    p->touch = touch;
    tact_controller_reset(&p->state);
    tact_touch_reset(p->touch, &p->touch_state);
}

float product_step(void *controller, float reference, float position_v)
{
    product *p = controller;
    if (p->touch->feedback_count == 0)
        return tact_controller_step(p->table, &p->state, reference, position_v);
    const float wanted_v = tact_adaptive_step(p->table, p->touch, &p->state, &p->touch_state, reference, position_v);
    const float command_v = tact_controller_limit(p->table, &p->state, reference, wanted_v);
    tact_touch_put(p->touch, &p->touch_state, command_v);
    return command_v;
}

void product_weights(const product *p, double *weights)
{
    weights[0] = (double)p->touch_state.weight[0];
    weights[1] = (double)p->touch_state.weight[1];
}

/* Puts `value` in place of one of the estimator's numbers; 0 where `at` is beyond the last. */
int product_spoil(product *p, size_t at, float value)
{
    const size_t first = offsetof(tact_touch_state, balance) / sizeof(float);
    const size_t counts = offsetof(tact_touch_state, at) / sizeof(float) - first;
    const size_t place = first + at + (at >= counts ? 2 : 0);
    if (place >= sizeof(tact_touch_state) / sizeof(float))
        return 0;
    ((float *)(void *)&p->touch_state)[place] = value;
    return 1;
}
