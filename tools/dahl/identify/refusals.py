# SPDX-License-Identifier: MIT
"""What to do next if a parameter is not claimed: one step for each reason.

docs/identify.md has the same table. The name of a lack of fit is that of its row in diagnose.py.
"""

from __future__ import annotations

NEXT_STEPS = {
    "unit of the angle": "give --angle-unit",
    "unit of the torque": "give --torque-unit",
    "swapped columns": "exchange --angle and --torque",
    "little explained": "record strokes in which friction is most of the torque",
    "no friction": "record longer strokes, in which friction slips, of the bearing alone",
    "negative inertia": "record strokes of several speeds, or leave inertia out (--terms)",
    "few cycles": "record at least eight cycles, so that six can be scored",
    "noise": "record more cycles, or use a quieter torque sensor",
    "law, lag and terms": "record strokes of several lengths and speeds, as dahl excite proposes",
    "unexplained torque": "record friction alone: no load, no stops, strokes over the same angles",
    "hidden travel": "use an encoder with more counts, or smooth turns",
    "short presliding": "move slower, with 8 rows and 4 counts or more in a presliding length",
    "law and lag": "record a faster and a slower motion, and the torque without a filter",
    "law and play": "remove the play, or put the encoder on the bearing",
    "peak after a rest": "record strokes without rests",
    "steepest at rest": "move slower, with more counts in a presliding length",
    "no end of the interval": "record longer strokes, of three presliding lengths or more",
    "shape since the turn": "record the torque without a filter, on a stiff shaft",
    "low pass or delay": "record angle and torque with one clock, at two speeds or more",
    "speed": "record strokes of two speeds or more, as dahl excite proposes",
    "viscous": "record strokes of two speeds or more, as dahl excite proposes",
    "direction": "use --model asymmetric, or remove a load that acts one way",
    "angle ripple": "record shorter strokes, or over a whole number of periods of the ripple",
    "encoder error": "record strokes of several lengths, or calibrate the encoder",
    "delay of each log": "record all logs with one set-up, or identify each alone",
}
SOURCES = {  # of the width of an interval: its step
    "noise": "noise",
    "hypotheses": "law, lag and terms",
    "lack of fit": "unexplained torque",
    "counts": "hidden travel",
}


def next_step(reason: str) -> str:
    """Return the step for a reason; a row of an encoder error names its counts after it."""
    return NEXT_STEPS.get(reason) or next(
        (step for name, step in NEXT_STEPS.items() if reason.startswith(name)),
        NEXT_STEPS["unexplained torque"],
    )
