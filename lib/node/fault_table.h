/* SPDX-License-Identifier: MIT */
/**
 * @file fault_table.h
 * @brief Fault table: the reaction of the node to each frame, and to missing frames.
 *
 * The table exists once. The unit test of the node runs each row, and tools/fault_table.py writes the table into
 * the documentation. The product does not compile it.
 *
 * Columns: name of the row; frame; counts that increment (members of dahl_node_counts_t); state that Status
 * reports; whether the bristle moves or is kept; whether the node answers. Unless a row says otherwise, frames
 * arrive within the timeout, and counters are relative to the last frame in sequence. Frames out of sequence or too
 * far away are consecutive if each has the counter after the one before. An accepted count ends such a run;
 * repeated, bad and invalid frames do not.
 */
#ifndef FAULT_TABLE_H
#define FAULT_TABLE_H

#define FAULT_TABLE(ROW) \
    ROW(FIRST, "the first good one", "ok", INIT, "kept", true) \
    ROW(NEXT, "counter + 1", "ok", OK, "moved", true) \
    ROW(GAP, "counter + 2 or + 3", "ok, lost", LOST, "moved", true) \
    ROW(LONG_GAP, "counter + 4 to + 8, with a MaxStep", "ok, lost", LOST, "moved", true) \
    ROW(AGAIN, "the same counter again", "repeated", REPEATED, "kept", false) \
    ROW(OTHER, "any other counter", "wrong_sequence", WRONG_SEQUENCE, "kept", false) \
    ROW(FAR, "counter + 1, further away than MaxStep allows", "jump", OK, "kept", false) \
    ROW(FAR_GAP, "counter + 2 to + 8, further away than MaxStep allows", "lost, jump", LOST, "kept", false) \
    ROW(THIRD, "third consecutive frame of any other counter, if valid; without a MaxStep, or further away than it allows", "wrong_sequence", WRONG_SEQUENCE, "kept", true) \
    ROW(THIRD_FAR, "counter + 1, third consecutive frame further away than MaxStep allows", "jump", WRONG_SEQUENCE, "kept", true) \
    ROW(THIRD_NEAR, "third consecutive frame of any other counter, if valid; as near as MaxStep allows", "ok", LOST, "moved", true) \
    ROW(DISOWNED, "counter + 1, not valid by its own flag", "invalid", OK, "kept", false) \
    ROW(DISOWNED_GAP, "counter + 2 or + 3, with a MaxStep to + 8, not valid by its own flag", "lost, invalid", LOST, "kept", false) \
    ROW(DISOWNED_FIRST, "not valid by its own flag, before the first good one", "invalid", INIT, "kept", false) \
    ROW(BAD_CRC, "wrong CRC", "crc", CRC, "kept", false) \
    ROW(BAD_LENGTH, "wrong length", "format", CRC, "kept", false) \
    ROW(EXTENDED, "extended id", "format", CRC, "kept", false) \
    ROW(REMOTE, "remote frame", "format", CRC, "kept", false) \
    ROW(FD, "CAN FD frame", "format", CRC, "kept", false) \
    ROW(SILENCE, "nothing good for the timeout", "stale", STALE, "kept", false) \
    ROW(BACK_TWO, "after that: the first and the second good one in a row", "rearm", STALE, "kept", false) \
    ROW(BACK_THREE, "after that: the third in a row", "ok", STALE, "kept", true) \
    ROW(GONE_OFF, "the controller goes bus-off", "bus_off", STALE, "kept", false) \
    ROW(OFF_HELD, "good ones after that, within the timeout", "rearm", STALE, "kept", false) \
    ROW(OFF_BACK, "good ones after that: the third in a row", "ok", STALE, "kept", true) \
    ROW(OFF_LATCHED, "good ones after four bus-offs without an answer in between", "rearm", STALE, "kept", false)

#endif
