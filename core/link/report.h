/* Reports of a board over the link: its status, and rows of its trace.
 *
 *     STATUS: name (16) | channels, mode, fault, fault's channel (255: none), at rest, allows hold, delay | rate_hz f32 |
 *     checksums of safety table, image, simulated display | capacities of stream and trace | run, tick of the run, ticks
 *     in all, late interrupts, end of the stream, frames heard, frames dropped, tick of the fault, sensor and travel
 *     faults, those acknowledged, ticks until a fault may be cleared, most cycles of a step of this run,
 *     what is missing (TACT_MISSING_...)
 *
 *     TRACE: first tick, count u16, rows: channels command codes | flags << 24, channels position codes, and, if asked,
 *     channels displacements (mm, f32) of a simulated display
 *
 *     WEIGHTS: tick of the run | of each channel what it has learnt of its finger: the weight of the mass, of damping with
 *     stiffness (f32); zeros where nothing is fed forward
 *
 * Example use:
 *   outcome = tact_report_status(link, &writer);
 */
#ifndef TACT_REPORT_H
#define TACT_REPORT_H

#include "wire/bytes.h"
#include "link/link.h"

/* Each gives the tact_outcome; what it has to say goes into `out`. */
int32_t tact_report_status(const tact_link *link, tact_writer *out);
int32_t tact_report_trace(const tact_link *link, tact_reader *in, tact_writer *out);
int32_t tact_report_weights(const tact_link *link, const tact_reader *in, tact_writer *out);

#endif
