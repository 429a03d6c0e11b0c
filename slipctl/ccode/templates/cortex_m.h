/* What a test on the board needs: a clock that counts instructions, and how deep the stack went.
 *
 * SPDX-License-Identifier: Apache-2.0 (see LICENSE)
 */

#ifndef CORTEX_M_H
#define CORTEX_M_H

/* Start the timer that clock_now reads. */
void clock_start(void);

/* Time in ticks of the timer, 25 MHz, counting up. */
unsigned long clock_now(void);

/* Instructions between two readings, if one instruction takes 128 ns: qemu -icount shift=7. */
unsigned long instructions(unsigned long from, unsigned long to);

/* Paint the stack below the caller. */
void stack_paint(void);

/* Bytes of the painted stack that were used since; 64 if at most that. */
unsigned long stack_used(void);

/* Serial line, 8 bits: one byte out; one byte in, or -1 if none came within some polls. */
void serial_start(void);
void serial_put(unsigned char byte);
int serial_get(unsigned long polls);

#endif
