/* SPDX-License-Identifier: MIT */
/* SPI commands and registers of the MCP2515 that can_node.c uses, by DS20001801. */
#ifndef MCP2515_H
#define MCP2515_H

#include <dahl_can_bus.h>
#include "can_node.h"

enum {
    MCP_WRITE = 0x02,       /* address, values */
    MCP_READ = 0x03,        /* address */
    MCP_MODIFY = 0x05,      /* address, mask, value */
    MCP_LOAD_TX = 0x40,     /* + 2 * buffer: 13 bytes from TXBnSIDH */
    MCP_SEND = 0x80,        /* + 1 << buffer */
    MCP_READ_RX = 0x90,     /* + 4 * buffer: 13 bytes from RXBnSIDH; then RXnIF is cleared */
    MCP_READ_STATUS = 0xA0, /* bits 2 and 4: buffers 0 and 1 wait to be sent */
    MCP_RESET = 0xC0
};

enum {
    MCP_RXF0SIDH = 0x00, /* filters 0 to 2, with 4 bytes each */
    MCP_CANSTAT = 0x0E,
    MCP_CANCTRL = 0x0F,
    MCP_RXF3SIDH = 0x10, /* filters 3 to 5 */
    MCP_RXM0SIDH = 0x20, /* both masks, then CNF3, CNF2, CNF1 and CANINTE */
    MCP_CANINTF = 0x2C,
    MCP_EFLG = 0x2D,
    MCP_TXB0CTRL = 0x30, /* TXB1CTRL is 0x10 higher */
    MCP_RXB0CTRL = 0x60
};

enum {
    MCP_CANSTAT_MODE = 7 << 5,
    MCP_CANSTAT_CONFIGURATION = 4 << 5,
    MCP_RX0IF = 1 << 0, /* CANINTE has the same bits as CANINTF */
    MCP_RX1IF = 1 << 1,
    MCP_ERRIF = 1 << 5,
    MCP_EFLG_TXBO = 1 << 5,     /* bus-off; the controller recovers by itself after 128 times 11 recessive bits */
    MCP_EFLG_OVERFLOW = 3 << 6, /* of both receive buffers; only the program clears it */
    MCP_TXREQ = 1 << 3,
    MCP_RXB0CTRL_BUKT = 1 << 2, /* if buffer 0 is full, its frames go to buffer 1 */
    MCP_SIDL_SRR = 1 << 4       /* a remote frame */
};

uint8_t mcp_command(const can_board_t *board, const uint8_t *command, uint8_t length); /* returns the last byte received */
uint8_t mcp_read(const can_board_t *board, uint8_t address);
void mcp_write(const can_board_t *board, uint8_t address, uint8_t value);
void mcp_clear(const can_board_t *board, uint8_t address, uint8_t bits);

bool mcp_reset(const can_board_t *board); /* false: no chip answers */
void mcp_receive(const can_board_t *board, int buffer, dahl_can_frame_t *frame);
bool mcp_send(const can_board_t *board, int buffer, const dahl_can_frame_t *frame); /* false: the buffer is full */

#endif
