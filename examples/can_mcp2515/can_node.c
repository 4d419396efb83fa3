/* SPDX-License-Identifier: MIT */
/* The friction node on an MCP2515 with 16 MHz at 500 kbit/s, by DS20001801. It was not run on hardware. */
#include <dahl_node.h>
#include "can_node.h"
#include "mcp2515.h"

#define ID_BYTES(id) (id) >> 3, ((id)&7u) << 5, 0, 0 /* SIDH, SIDL, EID8, EID0 of a filter for standard frames */
#define ID ID_BYTES(DAHL_FRAMES_ID_ENCODER | 0u)     /* of node 0 */
#define MASK ID_BYTES(0x70Fu)                        /* passes 0x100, 0x110 .. 0x170; the node ignores those it does not use */
#define BIT_TIMING 0x01, 0xB5, 0x00                  /* CNF3 to CNF1: 2 / 16 MHz; bits of 1 + 6 + 7 + 2, sampled at 88 % */
enum { ANSWER_BUFFER, STATUS_BUFFER };               /* one for each, so that answers stay in order */
static const dahl_params_t params = {100.0f, 0.5f, 6.2831853f / 16384}; /* sigma0 N m/rad, Fc N m, rad/count */
static dahl_node_t node;
static const can_board_t *board;
static bool is_off; /* the bus */
volatile uint32_t can_dropped;

int can_node_init(const can_board_t *functions)
{
    static const uint8_t setup[3][14] = {{MCP_WRITE, MCP_RXF0SIDH, ID, ID, ID},
                                         {MCP_WRITE, MCP_RXF3SIDH, ID, ID, ID},
                                         {MCP_WRITE, MCP_RXM0SIDH, MASK, MASK, BIT_TIMING, MCP_RX0IF | MCP_RX1IF | MCP_ERRIF}};
    board = functions;
    int code = mcp_reset(board) ? dahl_node_init(&node, &params, 0) : CAN_NODE_NO_CHIP;
    for (int k = 0; k < 3 && code == DAHL_OK; k++) {
        mcp_command(board, setup[k], sizeof setup[k]);
    }
    mcp_write(board, MCP_RXB0CTRL, MCP_RXB0CTRL_BUKT);
    mcp_write(board, MCP_CANCTRL, code == DAHL_OK ? 0 : MCP_CANSTAT_CONFIGURATION); /* 0: normal mode */
    return code;
}

static void receive(int buffer)
{
    dahl_can_frame_t in, out;
    mcp_receive(board, buffer, &in);
    if (dahl_node_receive(&node, &in, board->clock_us(), &out)) {
        can_dropped += !mcp_send(board, ANSWER_BUFFER, &out);
    }
}

static void handle_error(void)
{
    bool was_off = is_off;
    mcp_clear(board, MCP_CANINTF, MCP_ERRIF);
    mcp_clear(board, MCP_EFLG, MCP_EFLG_OVERFLOW);
    is_off = (mcp_read(board, MCP_EFLG) & MCP_EFLG_TXBO) != 0;
    if (is_off && !was_off) {
        mcp_clear(board, MCP_TXB0CTRL, MCP_TXREQ); /* the controller recovers by itself, and must not send old torques */
        mcp_clear(board, MCP_TXB0CTRL + 0x10, MCP_TXREQ);
        dahl_node_bus_off(&node, board->clock_us());
    }
}

void can_node_interrupt(void)
{
    uint8_t flags = MCP_ERRIF;
    for (int round = 0; round < 8 && flags != 0; round++) { /* bounded: a broken SPI must not hang it */
        flags = mcp_read(board, MCP_CANINTF) & (MCP_RX0IF | MCP_RX1IF | MCP_ERRIF);
        for (int buffer = 0; buffer < 2; buffer++) {
            if ((flags >> buffer & 1) != 0) {
                receive(buffer);
            }
        }
        if ((flags & MCP_ERRIF) != 0 || is_off) {
            handle_error();
        }
    }
}

void can_node_tick(void)
{
    dahl_can_frame_t out;
    board->mask();        /* the interrupt uses the node and SPI, too */
    can_node_interrupt(); /* polls the end of a bus-off, and a missed edge of INT */
    if (dahl_node_tick(&node, board->clock_us(), &out)) {
        can_dropped += !mcp_send(board, STATUS_BUFFER, &out);
    }
    board->unmask();
}
