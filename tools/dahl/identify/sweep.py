# SPDX-License-Identifier: MIT
"""All that a fit needs of a log, as small matrices: one pass per value of a, none afterwards.

For one a = sigma0/Fc everything else is linear (variable projection):

    torque = Fc w(a) + F0 exp(-a travel) + offset + spring theta + viscous speed + inertia speed'

F0 is the torque at the first row, which nobody measured. The products of these columns are summed
over blocks of rows (a Gram matrix each). From them come the fit, the choice of terms, the held-out
error and the intervals, by leaving blocks or columns out, without looking at the rows again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dahl.identify import path
from dahl.identify.log import Log

CORE = ("offset", "spring", "viscous", "inertia")  # terms, in the order of their columns
FRICTION, START, FIRST_TERM = 0, 1, 2  # columns: w, exp(-a travel), then CORE, then the torque
WIDTH = FIRST_TERM + len(CORE) + 1
FORGOTTEN = 40.0  # travel in presliding lengths after which exp(-travel) is left out
SMOOTH = 9  # rows over which speed and its change are taken

Model = Callable[[np.ndarray, float], np.ndarray]


@dataclass
class Sweep:
    """Gram matrices for each a and block."""

    a: np.ndarray  # (nodes,) 1/rad, rising
    gram: np.ndarray  # (nodes, blocks, WIDTH, WIDTH); the torque is the last column
    owner: np.ndarray  # (blocks,) index of the log

    def with_nodes(self, other: Sweep) -> Sweep:
        """Both together, sorted by a."""
        order = np.argsort(np.concatenate((self.a, other.a)))
        gram = np.concatenate((self.gram, other.gram))[order]
        return Sweep(np.concatenate((self.a, other.a))[order], gram, self.owner)

    def total(self, use: np.ndarray | None = None) -> np.ndarray:
        """Sum over the blocks in `use` (bool, all by default), each log's F0 projected out:
        (nodes, WIDTH, WIDTH).
        """
        use = np.ones(len(self.owner), dtype=bool) if use is None else use
        parts = [
            without_start(self.gram[:, use & (self.owner == log)].sum(axis=1))
            for log in np.unique(self.owner)
        ]
        return np.sum(parts, axis=0)


def without_start(gram: np.ndarray) -> np.ndarray:
    """Project the START column out of (..., WIDTH, WIDTH): the best F0 for whatever else is
    chosen. Its own row and column become 0.
    """
    own = gram[..., START, START][..., None, None]
    across = gram[..., :, START, None] * gram[..., None, START, :]
    return gram - np.divide(across, own, out=np.zeros_like(gram), where=own > 1e-9)


@dataclass
class Fixed:
    """What does not depend on a, for one log."""

    log: Log
    columns: np.ndarray  # (rows, len(CORE) + 1): terms and torque, times the root of the weight
    root: np.ndarray  # (rows,) root of the weight
    moves: np.ndarray
    travelled: np.ndarray  # rad (m) since the first row
    length: int  # rows of a block


def fixed(log: Log, blocks: int) -> Fixed:
    """Prepare one log for `blocks` blocks."""
    moves = log.moves if log.free_moves is None else log.free_moves
    root = np.ones(log.rows) if log.weight is None else np.sqrt(log.weight)
    columns = np.empty((log.rows, len(CORE) + 1))
    columns[:, 0] = 1
    columns[:, 1] = log.theta - log.zero
    columns[:, 2], columns[:, 3] = speed_of(log)
    columns[:, 4] = log.torque
    columns *= root[:, None]
    length = max(-(-log.rows // blocks), 1)
    return Fixed(log, columns, root, moves, np.cumsum(np.abs(moves)), length)


def speed_of(log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Speed and its change, smoothed over SMOOTH rows; zeros where the log has no time."""
    if log.time is None or log.rows < 3 * SMOOTH:
        return np.zeros(log.rows), np.zeros(log.rows)
    speed = _smooth(_slope(log.theta, log.time))
    return speed, _smooth(_slope(speed, log.time))


def _slope(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Central differences; rows with one and the same time borrow their neighbour's."""
    ahead, behind = np.minimum(np.arange(len(time)) + 1, len(time) - 1), np.arange(len(time)) - 1
    behind[0] = 0
    step = time[ahead] - time[behind]
    least = np.median(step[step > 0]) * 1e-3 if (step > 0).any() else 1.0
    return (values[ahead] - values[behind]) / np.maximum(step, least)


def _smooth(values: np.ndarray) -> np.ndarray:
    half = SMOOTH // 2
    padded = np.pad(values, half, mode="edge")
    total = np.cumsum(np.concatenate(([0.0], padded)))
    return (total[SMOOTH:] - total[:-SMOOTH]) / SMOOTH


def sweep(fixeds: Sequence[Fixed], nodes: np.ndarray, model: Model = path.dahl) -> Sweep:
    """The Gram matrices of all logs at each a in `nodes` (1/rad)."""
    still = [_gram(_blocks(one.columns, one.length)) for one in fixeds]
    nodes = np.sort(np.asarray(nodes, dtype=float))
    gram = np.array([_node(fixeds, still, a, model) for a in nodes])
    owner = np.concatenate([np.full(len(part), i) for i, part in enumerate(still)])
    return Sweep(nodes, gram, owner)


def _node(fixeds: Sequence[Fixed], still: list, a: float, model: Model) -> np.ndarray:
    return np.concatenate([_log_at(one, part, a, model) for one, part in zip(fixeds, still)])


def _log_at(one: Fixed, still: np.ndarray, a: float, model: Model) -> np.ndarray:
    """(blocks, WIDTH, WIDTH) of one log at one a."""
    moving = np.zeros((len(one.moves), 2))
    moving[:, 0] = model(one.moves, a) * one.root
    near = int(np.searchsorted(one.travelled, FORGOTTEN / a, side="right"))
    moving[:near, 1] = np.exp(-a * one.travelled[:near]) * one.root[:near]
    moving, columns = _blocks(moving, one.length), _blocks(one.columns, one.length)
    gram = np.empty((len(still), WIDTH, WIDTH))
    gram[:, :FIRST_TERM, :FIRST_TERM] = _gram(moving)
    gram[:, FIRST_TERM:, FIRST_TERM:] = still
    across = np.swapaxes(moving, 1, 2) @ columns
    gram[:, :FIRST_TERM, FIRST_TERM:] = across
    gram[:, FIRST_TERM:, :FIRST_TERM] = np.swapaxes(across, 1, 2)
    return gram


def _gram(blocks: np.ndarray) -> np.ndarray:
    return np.swapaxes(blocks, 1, 2) @ blocks


def _blocks(columns: np.ndarray, length: int) -> np.ndarray:
    """(rows, k) -> (blocks, length, k), the last one filled up with zeros."""
    count = -(-len(columns) // length)
    if count * length != len(columns):
        columns = np.concatenate((columns, np.zeros((count * length - len(columns), columns.shape[1]))))
    return columns.reshape(count, length, -1)
