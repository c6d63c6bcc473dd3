#include "display/simulated_board.h"

#include "display/finger_request.h"

#include "wire/bytes.h"
#include "wire/crc32.h"
#include "board/period.h"

#define NUMBER_MAX 1e15

enum { SHORT_RUN = 32, LONG_RUN = 1 << 16 }; /* periods before the host is heard */

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
    table->plant_count = integer(reader, 1, TACT_SIMULATED_BOARD_PLANTS_MAX);
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
    /* as in a safety table: a range near zero has no finite steps per volt */
    if (reader->overrun || range_v < 1e-3 || range_v > 31.0 || offset_v < -31.0 || offset_v > 31.0 || polarity == 0) {
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

void tact_simulated_board_reset(tact_simulated_board *simulated, float *force, float *felt_mm)
{
    uint8_t *bytes = (uint8_t *)simulated;
    for (size_t i = 0; i < sizeof *simulated; i++)
        bytes[i] = 0;
    simulated->force = force;
    simulated->felt_mm = felt_mm;
}

int tact_simulated_board_parse(tact_simulated_board *simulated, const uint8_t *bytes, size_t size, int32_t channels)
{
    tact_simulated_board_reset(simulated, simulated->force, simulated->felt_mm);
    if (size < 20 || size > TACT_SIMULATED_BOARD_MAX)
        return 0;
    tact_reader reader = {bytes, size, size - 4, 0};
    const uint32_t crc = tact_read_u32(&reader);
    reader = (tact_reader){bytes, size - 4, 0, 0};
    if (crc != tact_crc32(0, bytes, size - 4) || tact_read_u32(&reader) != TACT_SIMULATED_BOARD_MAGIC ||
        tact_read_u16(&reader) != TACT_SIMULATED_BOARD_VERSION || tact_read_u16(&reader) != channels ||
        tact_read_u32(&reader) != size || channels > TACT_CHANNELS_MAX)
        return 0;
    const uint32_t seed = tact_read_u32(&reader);
    for (int32_t c = 0; c < channels && !reader.overrun; c++) {
        read_channel(&reader, &simulated->table[c], simulated->plant[c]);
        tact_display_reset(&simulated->table[c], &simulated->state[c], seed, (uint32_t)c);
    }
    if (reader.overrun || reader.at != size - 4)
        return 0;
    simulated->channels = channels;
    simulated->crc = crc;
    return 1;
}

static int take(void *context, const uint8_t *bytes, size_t size, int32_t channels)
{
    return tact_simulated_board_parse(context, bytes, size, channels);
}

void tact_simulated_board_join(tact_simulated_board *simulated, tact_link *link)
{
    link->display = (tact_link_display){simulated,        take,
                                        tact_simulated_board_touch, simulated->force,
                                        simulated->felt_mm, &simulated->crc};
}

void tact_simulated_board_latch(tact_simulated_board *simulated, const int32_t *codes)
{
    for (int32_t c = 0; c < simulated->channels; c++) {
        tact_display_state *state = &simulated->state[c];
        const double stop_v = tact_sensor_fault_force_v(&simulated->sensor[c], state->displacement_mm);
        (void)tact_display_latch(&simulated->table[c], state, codes[c], (double)simulated->force_v[c] + stop_v);
    }
}

void tact_simulated_board_read(tact_simulated_board *simulated, int32_t *codes)
{
    int32_t sound[TACT_CHANNELS_MAX];
    for (int32_t c = 0; c < simulated->channels; c++)
        sound[c] = tact_display_read(&simulated->table[c], &simulated->state[c]);
    for (int32_t c = 0; c < simulated->channels; c++)
        codes[c] = simulated->code[c] = tact_sensor_fault_apply(
            &simulated->sensor[c], &simulated->table[c].converter, sound, simulated->channels, c);
}

void tact_simulated_board_advance(tact_simulated_board *simulated)
{
    for (int32_t c = 0; c < simulated->channels; c++)
        tact_display_advance(&simulated->table[c], &simulated->state[c]);
}

void tact_simulated_board_feel(tact_simulated_board *simulated, const tact_board *board)
{
    const uint32_t row = board->tick & (board->trace_capacity - 1);
    for (int32_t c = 0; c < simulated->channels; c++)
        simulated->felt_mm[row * (uint32_t)simulated->channels + (uint32_t)c] =
            (float)simulated->state[c].displacement_mm;
}

void tact_simulated_board_press(tact_simulated_board *simulated, const tact_board *board)
{
    const uint32_t tick = board->tick, row = tick & (board->stream_capacity - 1);
    const int streams = board->mode == TACT_RUNNING && board->source == TACT_STREAM &&
                        tick - board->stream_at < board->stream_end - board->stream_at;
    for (int32_t c = 0; c < simulated->channels; c++)
        simulated->force_v[c] = streams ? simulated->force[row * (uint32_t)simulated->channels + (uint32_t)c] : 0.0f;
}

int tact_simulated_board_period(tact_simulated_board *simulated, tact_board *board, uint32_t lateness)
{
    int32_t codes[TACT_CHANNELS_MAX];
    if (simulated->channels != board->channels || tact_board_waits(board))
        return 0;
    tact_board_give_tones(board);
    tact_period_latch(board, codes);
    tact_simulated_board_press(simulated, board);
    tact_simulated_board_latch(simulated, codes);
    tact_simulated_board_read(simulated, codes);
    tact_simulated_board_feel(simulated, board);
    tact_period_step(board, codes, lateness);
    tact_simulated_board_advance(simulated);
    return 1;
}

uint32_t tact_simulated_board_run(tact_simulated_board *simulated, tact_board *board, uint32_t most)
{
    uint32_t periods = 0;
    while (periods < most && tact_simulated_board_period(simulated, board, 0))
        periods++;
    return periods;
}

int tact_simulated_board_goes_on(const tact_simulated_board *simulated, const tact_board *board, uint32_t passed)
{
    const int ends = board->ending != TACT_STOP_NONE, runs = board->mode == TACT_RUNNING || ends;
    const uint32_t most = board->holds && !ends ? LONG_RUN : SHORT_RUN;
    return runs && simulated->channels == board->channels && !tact_board_waits(board) && passed < most;
}

void tact_simulated_board_go_on(tact_simulated_board *simulated, tact_board *board)
{
    for (uint32_t passed = 0; tact_simulated_board_goes_on(simulated, board, passed); passed++)
        (void)tact_simulated_board_period(simulated, board, 0);
}
