#include "host/audio_rows.h"

#include <stddef.h>

/* Acquire and release are enough: each position has one writer. */
#if defined(__GNUC__)
#define LOAD(place) __atomic_load_n(&(place), __ATOMIC_ACQUIRE)
#define STORE(place, value) __atomic_store_n(&(place), (value), __ATOMIC_RELEASE)
#else /* x86 keeps the order of volatile reads and of volatile writes */
#define LOAD(place) (*(const volatile uint64_t *)&(place))
#define STORE(place, value) (*(volatile uint64_t *)&(place) = (value))
#endif

#define SILENT 1e-7f /* -140 dB */

enum { GAP_FLAGS = 1 | 2 | 4 | 8 }; /* PortAudio's input and output under- and overflow */

static void forget(tact_audio *audio)
{
    audio->fed = audio->read_to = audio->played = audio->taken = audio->gaps = 0;
    audio->begun = 0;
    audio->end = audio->dry_at = audio->lost_at = audio->gap_at = TACT_AUDIO_NEVER;
}

int tact_audio_reset(tact_audio *audio)
{
    if (!audio->capacity || !audio->outputs || audio->outputs > TACT_AUDIO_CHANNELS_MAX ||
        audio->inputs > TACT_AUDIO_CHANNELS_MAX || !audio->out || (audio->inputs && !audio->in))
        return 0;
    forget(audio);
    audio->state = audio->seen = 0;
    audio->frames = 0;
    audio->gain = 0.0f;
    for (size_t k = 0; k < TACT_AUDIO_CHANNELS_MAX; k++)
        audio->last[k] = 0.0f;
    return 1;
}

uint64_t tact_audio_feed(tact_audio *audio, const float *rows, uint64_t count)
{
    const uint64_t room = audio->capacity - (audio->fed - LOAD(audio->played));
    const uint64_t taken = count < room ? count : room;
    for (uint64_t k = 0; k < taken; k++) {
        float *place = audio->out + (audio->fed + k) % audio->capacity * audio->outputs;
        for (uint32_t j = 0; j < audio->outputs; j++)
            place[j] = rows[k * audio->outputs + j];
    }
    STORE(audio->fed, audio->fed + taken);
    return taken;
}

void tact_audio_begin(tact_audio *audio)
{
    STORE(audio->state, audio->state | 1);
}

void tact_audio_end(tact_audio *audio)
{
    STORE(audio->end, audio->fed);
}

void tact_audio_stop(tact_audio *audio)
{
    STORE(audio->state, audio->state + (audio->state & 1));
}

int tact_audio_forget(tact_audio *audio)
{
    if ((audio->state & 1) || LOAD(audio->seen) != audio->state)
        return 0;
    forget(audio);
    return 1;
}

uint64_t tact_audio_read(tact_audio *audio, float *rows, uint64_t count)
{
    const uint64_t there = LOAD(audio->taken) - audio->read_to;
    const uint64_t taken = count < there ? count : there;
    for (uint64_t k = 0; k < taken; k++) {
        const float *place = audio->in + (audio->read_to + k) % audio->capacity * audio->inputs;
        for (uint32_t j = 0; j < audio->inputs; j++)
            rows[k * audio->inputs + j] = place[j];
    }
    STORE(audio->read_to, audio->read_to + taken);
    return taken;
}

void tact_audio_look(const tact_audio *audio, uint64_t *played, uint64_t *taken, uint64_t *frames)
{
    *played = LOAD(audio->played);
    *taken = LOAD(audio->taken);
    *frames = LOAD(audio->frames);
}

/* Puts out a row of the run, or lets the last one die away. */
static uint64_t put_out(tact_audio *audio, float *output, uint64_t played, uint64_t fed, int runs)
{
    const int there = audio->dry_at == TACT_AUDIO_NEVER && played < fed && audio->gain > 0.0f;
    const float *row = audio->out + played % audio->capacity * audio->outputs;
    for (uint32_t j = 0; j < audio->outputs; j++) {
        const float dying = audio->last[j] * audio->decay;
        output[j] = audio->last[j] = there ? row[j] * audio->gain : (dying > -SILENT && dying < SILENT) ? 0.0f : dying;
    }
    if (!runs)
        audio->gain = audio->gain < SILENT ? 0.0f : audio->gain * audio->decay;
    return played + (uint64_t)there;
}

static uint64_t take_in(tact_audio *audio, const float *input, uint64_t taken, uint64_t read_to)
{
    if (taken - read_to >= audio->capacity) {
        if (audio->lost_at == TACT_AUDIO_NEVER)
            STORE(audio->lost_at, taken);
        return taken;
    }
    float *place = audio->in + taken % audio->capacity * audio->inputs;
    for (uint32_t j = 0; j < audio->inputs; j++)
        place[j] = input ? input[j] : 0.0f;
    return taken + 1;
}

int tact_audio_callback(const void *input, void *output, unsigned long frames, const void *times, unsigned long flags,
                        void *user)
{
    tact_audio *audio = user;
    const float *in = input;
    float *out = output;
    const uint64_t state = LOAD(audio->state);
    const int running = (int)(state & 1);
    const uint64_t fed = LOAD(audio->fed), end = LOAD(audio->end), read_to = LOAD(audio->read_to);
    uint64_t played = audio->played, taken = audio->taken;
    (void)times;
    if (running && (flags & GAP_FLAGS)) {
        if (audio->gap_at == TACT_AUDIO_NEVER)
            STORE(audio->gap_at, played);
        STORE(audio->gaps, audio->gaps + 1);
    }
    if (running && audio->seen != state) {
        audio->begun = audio->frames;
        audio->gain = 1.0f;
    }
    for (unsigned long k = 0; k < frames; k++) {
        if (running && played == fed && played < end && audio->dry_at == TACT_AUDIO_NEVER)
            STORE(audio->dry_at, played);
        played = put_out(audio, out + k * audio->outputs, played, fed, running);
        if (running)
            taken = take_in(audio, in ? in + k * audio->inputs : NULL, taken, read_to);
    }
    STORE(audio->played, played);
    STORE(audio->taken, taken);
    STORE(audio->frames, audio->frames + frames);
    if (running || audio->gain == 0.0f)
        STORE(audio->seen, state);
    return 0;
}
