# SPDX-License-Identifier: MIT
"""All that a fit needs of a log, as small matrices: one pass per value of a, none afterwards.

For one a = sigma0/Fc everything else is linear (variable projection):

    torque = Fc w(a) + F0 exp(-a travel) + offset + spring theta + viscous speed + ...

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
from dahl.identify.terms import TERMS, columns_of

FRICTION, START, FIRST_TERM = 0, 1, 2  # columns: w, exp(-a travel), then TERMS, the torque
WIDTH = FIRST_TERM + len(TERMS) + 1
FORGOTTEN = 40.0  # travel in presliding lengths after which exp(-travel) is left out

PIECE = 32768  # rows looked at together
TOGETHER = 5  # nodes

Model = Callable[[np.ndarray, float, float], np.ndarray]  # moves, a, F/Fc before -> F/Fc after each


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
        summed: np.ndarray = np.sum(parts, axis=0)
        return summed


def without_start(gram: np.ndarray) -> np.ndarray:
    """Project the START column out of (..., WIDTH, WIDTH): the best F0 for whatever else is
    chosen. Its own row and column become 0.
    """
    own = gram[..., START, START][..., None, None]
    across = gram[..., :, START, None] * gram[..., None, START, :]
    drawn = np.divide(across, own, out=np.zeros_like(gram), where=own > 1e-9)
    rest: np.ndarray = gram - drawn
    return rest


@dataclass(frozen=True)
class Piece:
    """Consecutive rows of one log, few enough to stay in the cache."""

    rows: slice
    block: int  # index of the first block in it, within the log
    length: int  # rows of a block; one block alone may be longer than the piece


def pieces(rows: int, blocks: int) -> list[Piece]:
    """Cut a log: whole blocks together while they are short, a long block into parts."""
    length = max(-(-rows // blocks), 1)
    if length <= PIECE:
        step = PIECE // length * length
        return [
            Piece(slice(i, min(i + step, rows)), i // length, length) for i in range(0, rows, step)
        ]
    return [
        Piece(slice(i, min(i + PIECE, end)), start // length, PIECE)
        for start in range(0, rows, length)
        for end in (min(start + length, rows),)
        for i in range(start, end, PIECE)
    ]


def sweep(logs: Sequence[Log], blocks: int, nodes: np.ndarray, model: Model = path.dahl) -> Sweep:
    """The Gram matrices of all logs, cut into `blocks` each, at each a in `nodes` (1/rad)."""
    nodes = np.sort(np.asarray(nodes, dtype=float))
    parts = [_log_at(log, blocks, nodes, model) for log in logs]
    owner = np.concatenate([np.full(part.shape[1], i) for i, part in enumerate(parts)])
    return Sweep(nodes, np.concatenate(parts, axis=1), owner)


def _log_at(log: Log, blocks: int, nodes: np.ndarray, model: Model) -> np.ndarray:
    """(nodes, blocks, WIDTH, WIDTH) of one log."""
    cut = pieces(log.rows, blocks)
    length = max(-(-log.rows // blocks), 1)
    gram = np.zeros((len(nodes), -(-log.rows // length), WIDTH, WIDTH))
    ratio, travelled = np.zeros(len(nodes)), 0.0  # where the piece before ended
    for piece in cut:
        moves = log.moves_of(piece.rows)
        root = np.ones(len(moves)) if log.weight is None else np.sqrt(log.weight[piece.rows])
        fixed = _blocks(columns_of(log, piece.rows) * root[:, None], piece.length)
        here = slice(piece.block, piece.block + len(fixed))
        gram[:, here, FIRST_TERM:, FIRST_TERM:] += _gram(fixed)
        travel = travelled + np.cumsum(np.abs(moves))
        for some in np.array_split(np.arange(len(nodes)), -(-len(nodes) // TOGETHER)):
            drawn = np.zeros((len(some), fixed.shape[0] * fixed.shape[1]))
            for row, i in zip(drawn, some, strict=True):
                row[: len(moves)] = model(moves, nodes[i], ratio[i])
                ratio[i] = row[len(moves) - 1]
                row[: len(moves)] *= root
            _add_friction(gram[some[0] : some[-1] + 1, here], drawn, fixed)
            for row, i in zip(drawn, some, strict=True):
                near = int(np.searchsorted(travel, FORGOTTEN / nodes[i], side="right"))
                start = np.exp(-nodes[i] * travel[:near]) * root[:near]
                _add_start(gram[i, here], start, row, fixed)
        travelled = travel[-1]
    return gram


def _add_friction(gram: np.ndarray, drawn: np.ndarray, fixed: np.ndarray) -> None:
    """Add the products of w at some nodes, (nodes, rows), to their blocks, (nodes, blocks, ..)."""
    w = drawn.reshape(len(drawn), *fixed.shape[:2])
    gram[:, :, FRICTION, FRICTION] += np.einsum("kbl,kbl->kb", w, w)
    across = np.swapaxes(w.swapaxes(0, 1) @ fixed, 0, 1)
    gram[:, :, FRICTION, FIRST_TERM:] += across
    gram[:, :, FIRST_TERM:, FRICTION] += across


def _add_start(gram: np.ndarray, start: np.ndarray, w: np.ndarray, fixed: np.ndarray) -> None:
    """Add the products of the torque at the first row, as far as it shows, to the blocks of one
    node.
    """
    length = fixed.shape[1]
    for block in range(-(-len(start) // length)):
        rows = slice(block * length, min((block + 1) * length, len(start)))
        own, here = start[rows], gram[block]
        here[START, START] += own @ own
        here[START, FRICTION] = here[FRICTION, START] = here[START, FRICTION] + own @ w[rows]
        here[START, FIRST_TERM:] += own @ fixed[block, : len(own)]
        here[FIRST_TERM:, START] = here[START, FIRST_TERM:]


def _gram(blocks: np.ndarray) -> np.ndarray:
    gram: np.ndarray = np.swapaxes(blocks, 1, 2) @ blocks
    return gram


def _blocks(columns: np.ndarray, length: int) -> np.ndarray:
    """(rows, k) -> (blocks, length, k), the last one filled up with zeros."""
    count = -(-len(columns) // length)
    if count * length != len(columns):
        missing = np.zeros((count * length - len(columns), columns.shape[1]))
        columns = np.concatenate((columns, missing))
    return columns.reshape(count, length, -1)
