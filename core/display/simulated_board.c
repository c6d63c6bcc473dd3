#include "display/simulated_board.h"

#include "wire/bytes.h"
#include "wire/crc32.h"
#include "board/period.h"

#define NUMBER_MAX 1e15

static double number(tact_reader *reader)
{
    const double value = tact_read_f64(reader);
    if (!(value < NUMBER_MAX && value > -NUMBER_MAX))
        reader->overrun = 1;
    return reader->overrun ? 0.0 : value;
}

static int32_t integer(tact_reader *reader, int32_t low, int32_t high)
{
    const int32_t value = tact_read_i32(reader);
    if (value < low || value > high)
        reader->overrun = 1;
    return reader->overrun ? low : value;
}

static void numbers(tact_reader *reader, double *into, int32_t count)
{
    for (int32_t i = 0; i < count; i++)
        into[i] = number(reader);
}

static void read_plants(tact_reader *reader, tact_display *table, tact_plant *plants)
{
    table->plants = plants;
    table->plant_count = integer(reader, 1, TACT_WIRED_PLANTS_MAX);
    const int32_t order = integer(reader, 1, TACT_ORDER_MAX);
    for (int32_t p = 0; p < table->plant_count; p++) {
        tact_plant *plant = &plants[p];
        plant->order = order;
        for (int32_t i = 0; i < order; i++)
            numbers(reader, plant->a[i], order);
        numbers(reader, plant->b, order);
        numbers(reader, plant->late, order);
        numbers(reader, plant->sensor, order);
        numbers(reader, plant->displacement, order);
        plant->sensor_direct = number(reader);
        plant->displacement_direct = number(reader);
    }
}

static void read_channel(tact_reader *reader, tact_display *table, tact_plant *plants)
{
    const int32_t bits = integer(reader, 8, 24);
    const int32_t polarity = integer(reader, -1, 1);
    const double range_v = number(reader), offset_v = number(reader);
    if (reader->overrun || range_v <= 0.0 || polarity == 0) {
        reader->overrun = 1;
        return;
    }
    tact_converter_make(&table->converter, bits, range_v, (double)polarity, offset_v);
    table->dead_time = integer(reader, 0, TACT_DEAD_TIME_MAX - 1);
    table->has_late = integer(reader, 0, 1);
    table->friction.stiffness = number(reader);
    table->friction.per_presliding = number(reader);
    table->sensor_v_per_mm = number(reader);
    table->noise_v = number(reader);
    table->hum.count = integer(reader, 0, TACT_HUM_MAX);
    for (int32_t i = 0; i < table->hum.count; i++) {
        table->hum.cosine[i] = number(reader);
        table->hum.sine[i] = number(reader);
        table->hum.amplitude_v[i] = number(reader);
    }
    read_plants(reader, table, plants);
}

void tact_wired_reset(tact_wired *wired, float *force, float *felt_mm)
{
    uint8_t *bytes = (uint8_t *)wired;
    for (size_t i = 0; i < sizeof *wired; i++)
        bytes[i] = 0;
    wired->force = force;
    wired->felt_mm = felt_mm;
}

int tact_wired_parse(tact_wired *wired, const uint8_t *bytes, size_t size, int32_t channels)
{
    tact_wired_reset(wired, wired->force, wired->felt_mm);
    if (size < 20 || size > TACT_WIRED_MAX)
        return 0;
    tact_reader reader = {bytes, size, size - 4, 0};
    const uint32_t crc = tact_read_u32(&reader);
    reader = (tact_reader){bytes, size - 4, 0, 0};
    if (crc != tact_crc32(0, bytes, size - 4) || tact_read_u32(&reader) != TACT_WIRED_MAGIC ||
        tact_read_u16(&reader) != TACT_WIRED_VERSION || tact_read_u16(&reader) != channels ||
        tact_read_u32(&reader) != size || channels > TACT_CHANNELS_MAX)
        return 0;
    const uint32_t seed = tact_read_u32(&reader);
    for (int32_t c = 0; c < channels && !reader.overrun; c++) {
        read_channel(&reader, &wired->table[c], wired->plant[c]);
        tact_display_reset(&wired->table[c], &wired->state[c], seed, (uint32_t)c);
    }
    if (reader.overrun || reader.at != size - 4)
        return 0;
    wired->channels = channels;
    wired->crc = crc;
    return 1;
}

void tact_wired_latch(tact_wired *wired, const int32_t *codes)
{
    for (int32_t c = 0; c < wired->channels; c++)
        (void)tact_display_latch(&wired->table[c], &wired->state[c], codes[c], (double)wired->force_v[c]);
}

static int32_t through_sensor(tact_wired *wired, int32_t channel, int32_t code)
{
    const tact_converter *converter = &wired->table[channel].converter;
    switch (wired->sensor[channel]) {
    case TACT_SENSOR_OPEN:
        return converter->code_max;
    case TACT_SENSOR_SHORTED:
        return 0;
    case TACT_SENSOR_FROZEN:
        return wired->code[channel];
    case TACT_SENSOR_REVERSED:
        return -code > converter->code_max ? converter->code_max : -code;
    default:
        return code;
    }
}

void tact_wired_read(tact_wired *wired, int32_t *codes)
{
    for (int32_t c = 0; c < wired->channels; c++) {
        const int32_t code = tact_display_read(&wired->table[c], &wired->state[c]);
        codes[c] = wired->code[c] = through_sensor(wired, c, code);
    }
}

void tact_wired_advance(tact_wired *wired)
{
    for (int32_t c = 0; c < wired->channels; c++)
        tact_display_advance(&wired->table[c], &wired->state[c]);
}

void tact_wired_feel(tact_wired *wired, const tact_board *board)
{
    const uint32_t row = board->tick & (board->trace_capacity - 1);
    for (int32_t c = 0; c < wired->channels; c++)
        wired->felt_mm[row * (uint32_t)wired->channels + (uint32_t)c] = (float)wired->state[c].displacement_mm;
}

void tact_wired_press(tact_wired *wired, const tact_board *board)
{
    const uint32_t tick = board->tick, row = tick & (board->stream_capacity - 1);
    const int streams = board->mode == TACT_RUNNING && board->source == TACT_STREAM &&
                        tick - board->stream_at < board->stream_end - board->stream_at;
    for (int32_t c = 0; c < wired->channels; c++)
        wired->force_v[c] = streams ? wired->force[row * (uint32_t)wired->channels + (uint32_t)c] : 0.0f;
}

int tact_wired_period(tact_wired *wired, tact_board *board, uint32_t lateness)
{
    int32_t codes[TACT_CHANNELS_MAX];
    if (wired->channels != board->channels || tact_board_waits(board))
        return 0;
    tact_period_latch(board, codes);
    tact_wired_press(wired, board);
    tact_wired_latch(wired, codes);
    tact_wired_read(wired, codes);
    tact_wired_feel(wired, board);
    tact_period_step(board, codes, lateness);
    tact_wired_advance(wired);
    return 1;
}

uint32_t tact_wired_run(tact_wired *wired, tact_board *board, uint32_t most)
{
    uint32_t periods = 0;
    while (periods < most && tact_wired_period(wired, board, 0))
        periods++;
    return periods;
}
