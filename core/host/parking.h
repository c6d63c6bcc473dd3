/* Abort in one thread parks that thread, and the program goes on.
 *
 * PortAudio asserts that its server answers: where it does not, the assertion calls abort, and that would be the end of
 * the whole program. Between tact_parking_begin and tact_parking_end an abort in the calling thread sets *parked and stops
 * that thread for ever; the other threads go on, and the library must not be called again. An abort in any other thread
 * ends the program as before.
 *
 * One thread of a process at a time: what answers a signal is the process's.
 *
 * Example use:
 *   tact_parking_begin(&parked);   result = library();   tact_parking_end();
 */
#ifndef TACT_PARKING_H
#define TACT_PARKING_H

/* From now on an abort parks the calling thread. parked: 0, and there for as long as the process. */
void tact_parking_begin(int *parked);

/* Ends it. */
void tact_parking_end(void);

/* Returns *parked as another thread set it. */
int tact_parking_taken(const int *parked);

#endif
