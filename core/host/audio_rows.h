/* Rows of samples between a program and a sound card, without a lock: the card's thread calls, the program feeds and reads.
 *
 *     program --tact_audio_feed--> | rows to put out | --+                         +--> outputs
 *                                                        +-- tact_audio_callback --+
 *     program <--tact_audio_read-- | rows taken in   | --+                         +<-- inputs
 *
 * tact_audio_callback has the form that PortAudio asks for and is called in PortAudio's own thread: it waits for nobody.
 * A run begins at the first row that is put out, and from there on every row taken in is kept, so that row k of both is
 * the same instant of the card's clock. What breaks a run is latched and stays for the program to see: a stream that ran
 * dry (dry_at), rows taken in that found no room (lost_at), and gaps that the card reports (gaps, gap_at). A run that
 * ran dry puts out nothing more; what was put out last dies away by `decay` a row, as after the end of every run.
 *
 * One thread feeds and reads, one calls. Positions only grow, and each has one writer; they are released by their writer
 * and acquired by the other side.
 *
 * Example use:
 *   tact_audio_begin(&audio, rows, 4800, outputs);   then give tact_audio_callback and &audio to PortAudio
 */
#ifndef TACT_AUDIO_ROWS_H
#define TACT_AUDIO_ROWS_H

#include <stdint.h>

enum { TACT_AUDIO_CHANNELS_MAX = 64 };

#define TACT_AUDIO_NEVER UINT64_MAX

typedef struct {
    float *out;        /* capacity rows of outputs samples */
    float *in;         /* capacity rows of inputs samples */
    uint64_t capacity; /* rows */
    uint32_t outputs;
    uint32_t inputs;
    float decay;                         /* a row, when there is nothing more or the run is stopped */
    float gain;                          /* 1 in a run */
    float last[TACT_AUDIO_CHANNELS_MAX]; /* put out last */
    uint64_t fed;                        /* rows given by the program; its own, as end, running and read_to are */
    uint64_t end;                        /* rows of the whole run; TACT_AUDIO_NEVER while more are to come */
    uint64_t read_to;                    /* rows taken in that the program has read */
    uint64_t state;                      /* odd: a run; one more with each beginning and each stop */
    uint64_t seen;                       /* the state that the last callback saw: the card's, as all that follows is */
    uint64_t played;                     /* rows put out */
    uint64_t taken;                      /* rows taken in */
    uint64_t frames;                     /* of the card since the stream was opened */
    uint64_t begun;                      /* the frame of the run's first row */
    uint64_t dry_at;                     /* row that was not there in time */
    uint64_t lost_at;                    /* row taken in that found no room */
    uint64_t gap_at;                     /* row at which the card reported the first gap */
    uint64_t gaps;                       /* callbacks in which it reported one */
} tact_audio;

/* Makes a stream without a run of `audio`, whose out, in, capacity, outputs, inputs and decay are set. 0: they cannot be. */
int tact_audio_reset(tact_audio *audio);

/* Takes up to `count` rows for the coming run or the one under way; returns how many there was room for. */
uint64_t tact_audio_feed(tact_audio *audio, const float *rows, uint64_t count);

/* Begins a run with the rows that were fed. */
void tact_audio_begin(tact_audio *audio);

/* Says that no more rows will be fed. */
void tact_audio_end(tact_audio *audio);

/* Stops a run: nothing more is put out or taken in. */
void tact_audio_stop(tact_audio *audio);

/* Forgets a run that was stopped, once its rows have died away; returns 1 then, 0 before. */
int tact_audio_forget(tact_audio *audio);

/* Copies up to `count` rows that were taken in; returns how many there were. */
uint64_t tact_audio_read(tact_audio *audio, float *rows, uint64_t count);

/* Positions as the card last reported them: rows put out, rows taken in, frames of its clock. */
void tact_audio_look(const tact_audio *audio, uint64_t *played, uint64_t *taken, uint64_t *frames);

/* PortAudio's callback; `user` is a tact_audio. Returns 0: go on. */
int tact_audio_callback(const void *input, void *output, unsigned long frames, const void *times, unsigned long flags,
                        void *user);

#endif
