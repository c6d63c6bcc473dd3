/* Files of the machine that runs the emulator. */
#ifndef TACT_SEMIHOSTING_H
#define TACT_SEMIHOSTING_H

#include <stddef.h>
#include <stdint.h>

/* A handle, or -1. writes: 0 to read from it, 1 to write to it. Opening a FIFO waits for its other end. */
int tact_host_open(const char *name, int writes);

/* Bytes read, at least one unless the other end is closed; waits, and time stands still meanwhile. */
size_t tact_host_read(int handle, uint8_t *bytes, size_t most);

void tact_host_write(int handle, const uint8_t *bytes, size_t size);

/* The end of the emulator. */
void tact_host_exit(void);

#endif
