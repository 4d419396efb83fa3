/* SPDX-License-Identifier: MIT */
/**
 * Fault tables: the reaction of the node to each frame, and to missing frames. The unit test of the node runs each
 * row, and tools/generators/facts.py writes the tables into the documentation. The product does not compile them.
 *
 * Both have the columns: name; ...; counts that increment (members of dahl_node_counts_t); state in Status; whether the
 * bristle moves or is kept; whether the node answers. Unless a row says otherwise, frames arrive within the timeout.
 *
 * FAULT_COUNTERS is for good and valid frames. Its first columns compare the frame with the last one in sequence: the
 * counter, and the distance of the count (MaxStep 0: no limit). The third one says if the frame is the third in a row
 * that is out of sequence or too far away. In a row, each frame has the counter after the one before. An accepted count
 * ends the row; repeated, bad and invalid frames do not. FAULT_EVENTS has all other frames and events.
 */
#ifndef FAULT_TABLE_H
#define FAULT_TABLE_H

#define FAULT_COUNTERS(ROW) \
    ROW(FIRST, "any, first good frame", "any", "", "ok", INIT, "kept", true) \
    ROW(NEXT, "+ 1", "0, within", "", "ok", OK, "moved", true) \
    ROW(GAP, "+ 2, + 3", "0, within", "", "ok, lost", LOST, "moved", true) \
    ROW(LONG_GAP, "+ 4 to + 8", "within", "", "ok, lost", LOST, "moved", true) \
    ROW(FAR, "+ 1", "exceeded", "no", "jump", OK, "kept", false) \
    ROW(FAR_GAP, "+ 2 to + 8", "exceeded", "no", "lost, jump", LOST, "kept", false) \
    ROW(THIRD_FAR, "+ 1", "exceeded", "yes", "jump", WRONG_SEQUENCE, "kept", true) \
    ROW(AGAIN, "the same", "any", "", "repeated", REPEATED, "kept", false) \
    ROW(OTHER, "any other", "any", "no", "wrong_sequence", WRONG_SEQUENCE, "kept", false) \
    ROW(THIRD, "any other", "0, exceeded", "yes", "wrong_sequence", WRONG_SEQUENCE, "kept", true) \
    ROW(THIRD_NEAR, "any other", "within", "yes", "ok", LOST, "moved", true)

#define FAULT_EVENTS(ROW) \
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
