/* SPDX-License-Identifier: MIT */
/**
 * Fault table: the reaction of the node to each frame, and to missing frames. The unit test of the node runs each
 * row, and tools/generators/facts.py writes the table into the documentation. The product does not compile it.
 *
 * Columns: name; frame; counts that increment (members of dahl_node_counts_t); state in Status; whether the bristle
 * moves or is kept; whether the node answers. Unless a row says otherwise, frames arrive within the timeout, and
 * counters are relative to the last frame in sequence. Frames out of sequence or too far away are consecutive if
 * each has the counter after the one before. An accepted count ends such a run; repeated, bad and invalid frames do
 * not.
 */
#ifndef FAULT_TABLE_H
#define FAULT_TABLE_H

#define FAULT_TABLE(ROW) \
    ROW(FIRST, "first good frame", "ok", INIT, "kept", true) \
    ROW(NEXT, "counter + 1", "ok", OK, "moved", true) \
    ROW(GAP, "counter + 2 or + 3", "ok, lost", LOST, "moved", true) \
    ROW(LONG_GAP, "counter + 4 to + 8, with MaxStep", "ok, lost", LOST, "moved", true) \
    ROW(AGAIN, "same counter as before", "repeated", REPEATED, "kept", false) \
    ROW(OTHER, "any other counter", "wrong_sequence", WRONG_SEQUENCE, "kept", false) \
    ROW(FAR, "counter + 1, exceeds MaxStep", "jump", OK, "kept", false) \
    ROW(FAR_GAP, "counter + 2 to + 8, exceeds MaxStep", "lost, jump", LOST, "kept", false) \
    ROW(THIRD, "any other counter, valid, third frame in a row; MaxStep is 0 or exceeded", "wrong_sequence", WRONG_SEQUENCE, "kept", true) \
    ROW(THIRD_FAR, "counter + 1, third frame in a row that exceeds MaxStep", "jump", WRONG_SEQUENCE, "kept", true) \
    ROW(THIRD_NEAR, "any other counter, valid, third frame in a row; within MaxStep", "ok", LOST, "moved", true) \
    ROW(DISOWNED, "counter + 1, marked invalid by the encoder", "invalid", OK, "kept", false) \
    ROW(DISOWNED_GAP, "counter + 2 or + 3 (with MaxStep up to + 8), marked invalid by the encoder", "lost, invalid", LOST, "kept", false) \
    ROW(DISOWNED_FIRST, "marked invalid by the encoder, before the first good frame", "invalid", INIT, "kept", false) \
    ROW(BAD_CRC, "wrong CRC", "crc", CRC, "kept", false) \
    ROW(BAD_LENGTH, "wrong length", "format", CRC, "kept", false) \
    ROW(EXTENDED, "extended id", "format", CRC, "kept", false) \
    ROW(REMOTE, "remote frame", "format", CRC, "kept", false) \
    ROW(FD, "CAN FD frame", "format", CRC, "kept", false) \
    ROW(SILENCE, "no accepted frame within the timeout", "stale", STALE, "kept", false) \
    ROW(BACK_TWO, "after a timeout: first and second good frame in a row", "rearm", STALE, "kept", false) \
    ROW(BACK_THREE, "after a timeout: third good frame in a row", "ok", STALE, "kept", true) \
    ROW(GONE_OFF, "the controller goes bus-off", "bus_off", STALE, "kept", false) \
    ROW(OFF_HELD, "after a bus-off: good frames within the timeout", "rearm", STALE, "kept", false) \
    ROW(OFF_BACK, "after a bus-off and the timeout: third good frame in a row", "ok", STALE, "kept", true) \
    ROW(OFF_LATCHED, "good frames after four bus-offs without an answer in between", "rearm", STALE, "kept", false)

#endif
