/* SPDX-License-Identifier: MIT */
#include <string.h>
#include "mcp2515.h"

uint8_t mcp_command(const can_board_t *board, const uint8_t *command, uint8_t length)
{
    uint8_t bytes[14];
    memcpy(bytes, command, length);
    board->transfer(bytes, length);
    return bytes[length - 1];
}

uint8_t mcp_read(const can_board_t *board, uint8_t address)
{
    const uint8_t command[] = {MCP_READ, address, 0};
    return mcp_command(board, command, sizeof command);
}

void mcp_write(const can_board_t *board, uint8_t address, uint8_t value)
{
    const uint8_t command[] = {MCP_WRITE, address, value};
    mcp_command(board, command, sizeof command);
}

void mcp_clear(const can_board_t *board, uint8_t address, uint8_t bits)
{
    const uint8_t command[] = {MCP_MODIFY, address, bits, 0};
    mcp_command(board, command, sizeof command);
}

bool mcp_reset(const can_board_t *board)
{
    const uint8_t command = MCP_RESET;
    mcp_command(board, &command, 1);
    board->wait_us(10); /* 128 periods of the oscillator */
    return (mcp_read(board, MCP_CANSTAT) & MCP_CANSTAT_MODE) == MCP_CANSTAT_CONFIGURATION;
}

/* Bytes of a buffer after the command: SIDH, SIDL, EID8, EID0, DLC, data. The filters pass standard frames only. */
void mcp_receive(const can_board_t *board, int buffer, dahl_can_frame_t *frame)
{
    uint8_t bytes[14] = {(uint8_t)(MCP_READ_RX + 4 * buffer)};
    board->transfer(bytes, sizeof bytes);
    uint8_t length = bytes[5] & 15;
    frame->id = (uint32_t)bytes[1] << 3 | bytes[2] >> 5;
    frame->flags = (bytes[2] & MCP_SIDL_SRR) != 0 ? DAHL_CAN_FRAME_REMOTE : 0;
    frame->length = length < 8 ? length : 8;
    memcpy(frame->data, bytes + 6, 8);
}

bool mcp_send(const can_board_t *board, int buffer, const dahl_can_frame_t *frame)
{
    const uint8_t status[] = {MCP_READ_STATUS, 0}, request = (uint8_t)(MCP_SEND | 1 << buffer);
    uint8_t bytes[14] = {(uint8_t)(MCP_LOAD_TX + 2 * buffer), (uint8_t)(frame->id >> 3), (uint8_t)(frame->id << 5)};
    if ((mcp_command(board, status, sizeof status) >> (2 + 2 * buffer) & 1) != 0) {
        return false;
    }
    bytes[5] = frame->length;
    memcpy(bytes + 6, frame->data, 8);
    mcp_command(board, bytes, sizeof bytes);
    mcp_command(board, &request, 1);
    return true;
}
