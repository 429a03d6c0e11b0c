/* A small XCP slave (ASAM MCD-1 XCP 1.x, calibration and measurement by polling): reads of memory,
 * and writes where a region allows them. The transport is the caller's.
 *
 * SPDX-License-Identifier: Apache-2.0 (see LICENSE)
 */

#ifndef XCP_H
#define XCP_H

#include <stdbool.h>
#include <stdint.h>

/* Longest packet, in bytes, of a command and of its answer. */
#define XCP_LONGEST 64U

/* Memory that a tool may reach, at the addresses that it writes: those of the ELF file. */
typedef struct xcp_region {
    uint32_t first;
    unsigned char *at;
    uint32_t size;
    bool writable;
} xcp_region;

/* One connection; zero at the start. */
typedef struct xcp {
    const xcp_region *regions;
    unsigned int count;
    bool connected;
    bool written; /* by a command since the caller cleared it */
    uint32_t address;
} xcp;

/* Answer a command of so many bytes; the length of the answer, 0 where there is none. */
unsigned int xcp_answer(xcp *x, const unsigned char *command, unsigned int length,
                        unsigned char answer[XCP_LONGEST]);

#endif
