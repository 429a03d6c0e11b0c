/* A small XCP slave; see xcp.h.
 *
 * SPDX-License-Identifier: Apache-2.0 (see LICENSE)
 */

#include "xcp.h"

#include <string.h>

/* Codes of ASAM MCD-1 XCP. */
enum {
    XCP_RES = 0xFF, XCP_ERR = 0xFE,
    XCP_CONNECT = 0xFF, XCP_DISCONNECT = 0xFE, XCP_GET_STATUS = 0xFD, XCP_SYNCH = 0xFC,
    XCP_SET_MTA = 0xF6, XCP_UPLOAD = 0xF5, XCP_SHORT_UPLOAD = 0xF4, XCP_DOWNLOAD = 0xF0,
    XCP_ERR_CMD_SYNCH = 0x00, XCP_ERR_CMD_UNKNOWN = 0x20, XCP_ERR_CMD_SYNTAX = 0x21,
    XCP_ERR_OUT_OF_RANGE = 0x22, XCP_ERR_WRITE_PROTECTED = 0x23,
    XCP_CALIBRATION = 0x01 /* resource: calibration and paging */
};

static unsigned int refuse(unsigned char *answer, int code)
{
    answer[0] = (unsigned char)XCP_ERR;
    answer[1] = (unsigned char)code;
    return 2U;
}

static uint32_t word(const unsigned char *from)
{
    return (uint32_t)from[0] | ((uint32_t)from[1] << 8) | ((uint32_t)from[2] << 16)
           | ((uint32_t)from[3] << 24);
}

/* The region that holds so many bytes from an address, or NULL. */
static const xcp_region *holding(const xcp *x, uint32_t address, uint32_t size)
{
    for (unsigned int k = 0U; k < x->count; ++k) {
        const xcp_region *r = &x->regions[k];
        if ((address >= r->first) && (address - r->first <= r->size)
              && (size <= r->size - (address - r->first))) {
            return r;
        }
    }
    return NULL;
}

static unsigned int upload(xcp *x, unsigned int size, unsigned char *answer)
{
    const xcp_region *r = holding(x, x->address, size);
    if ((size == 0U) || (size > XCP_LONGEST - 1U) || (r == NULL)) {
        return refuse(answer, XCP_ERR_OUT_OF_RANGE);
    }
    answer[0] = (unsigned char)XCP_RES;
    (void)memcpy(&answer[1], &r->at[x->address - r->first], size);
    x->address += size;
    return size + 1U;
}

static unsigned int download(xcp *x, const unsigned char *command, unsigned int length,
                             unsigned char *answer)
{
    const unsigned int size = command[1];
    const xcp_region *r = holding(x, x->address, size);
    if (size + 2U > length) {
        return refuse(answer, XCP_ERR_CMD_SYNTAX);
    }
    if ((size == 0U) || (r == NULL)) {
        return refuse(answer, XCP_ERR_OUT_OF_RANGE);
    }
    if (!r->writable) {
        return refuse(answer, XCP_ERR_WRITE_PROTECTED);
    }
    (void)memcpy(&r->at[x->address - r->first], &command[2], size);
    x->address += size;
    x->written = true;
    answer[0] = (unsigned char)XCP_RES;
    return 1U;
}

unsigned int xcp_answer(xcp *x, const unsigned char *command, unsigned int length,
                        unsigned char answer[XCP_LONGEST])
{
    if ((length == 0U) || (length > XCP_LONGEST) || (!x->connected && (command[0] != XCP_CONNECT))) {
        return 0U;
    }
    (void)memset(answer, 0, XCP_LONGEST);
    answer[0] = (unsigned char)XCP_RES;
    switch (command[0]) {
    case XCP_CONNECT:
        x->connected = true;
        answer[1] = (unsigned char)XCP_CALIBRATION;
        answer[3] = (unsigned char)XCP_LONGEST; /* of a command; bytes are the low one first */
        answer[4] = (unsigned char)XCP_LONGEST; /* of data */
        answer[6] = 1U;                         /* versions of protocol and transport */
        answer[7] = 1U;
        return 8U;
    case XCP_DISCONNECT:
        x->connected = false;
        return 1U;
    case XCP_GET_STATUS:
        return 6U;
    case XCP_SYNCH:
        return refuse(answer, XCP_ERR_CMD_SYNCH);
    case XCP_SET_MTA:
        if (length < 8U) {
            return refuse(answer, XCP_ERR_CMD_SYNTAX);
        }
        x->address = word(&command[4]);
        return 1U;
    case XCP_UPLOAD:
        return (length < 2U) ? refuse(answer, XCP_ERR_CMD_SYNTAX) : upload(x, command[1], answer);
    case XCP_SHORT_UPLOAD:
        if (length < 8U) {
            return refuse(answer, XCP_ERR_CMD_SYNTAX);
        }
        x->address = word(&command[4]);
        return upload(x, command[1], answer);
    case XCP_DOWNLOAD:
        return (length < 2U) ? refuse(answer, XCP_ERR_CMD_SYNTAX)
                             : download(x, command, length, answer);
    default:
        return refuse(answer, XCP_ERR_CMD_UNKNOWN);
    }
}
