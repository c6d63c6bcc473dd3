#include "display/finger_request.h"

#include "link/link.h"

/* The same fault again goes on: the request may have come twice. */
static void break_sensor(tact_sensor_fault *fault, int32_t kind, float value, int32_t code)
{
    if (fault->kind != kind || !(fault->value == value || (fault->value != fault->value && value != value)))
        tact_sensor_fault_set(fault, kind, value, code);
}

int32_t tact_simulated_board_touch(void *context, uint8_t type, tact_reader *in)
{
    tact_simulated_board *simulated = context;
    const uint32_t channel = tact_read_u8(in);
    const int32_t what = tact_read_u8(in);
    const float value = type == TACT_ASK_BREAK ? tact_read_f32(in) : 0.0f;
    if (in->overrun || in->at != in->size || channel >= (uint32_t)simulated->channels)
        return TACT_BAD_PAYLOAD;
    if (type == TACT_ASK_BREAK && what <= TACT_SENSOR_LAST)
        break_sensor(&simulated->sensor[channel], what, value, simulated->code[channel]);
    else if (type == TACT_ASK_TOUCH && what < simulated->table[channel].plant_count)
        simulated->state[channel].touched = what;
    else
        return TACT_BAD_PAYLOAD;
    return TACT_DONE;
}
