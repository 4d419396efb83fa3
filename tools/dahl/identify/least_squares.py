# SPDX-License-Identifier: MIT
"""Least squares by Gram matrices, one for each cycle, and the scatter over cycles left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import lsq_linear


def jackknife(values: np.ndarray) -> np.ndarray:
    """Standard error of estimates of which each lacks one cycle: (cycles, k) -> (k,)."""
    n = len(values)
    spread = np.sum((values - values.mean(axis=0)) ** 2, axis=0)
    error: np.ndarray = np.sqrt((n - 1) / n * spread)
    return error


def excess(cost: np.ndarray, best: np.ndarray) -> tuple[float, float]:
    """By how much a cost by cycle is above another, and the standard error of that."""
    more = cost - best
    return float(more.sum()), float(more.std(ddof=1) * np.sqrt(len(more)))


def solve(gram: np.ndarray, columns: Sequence[int]) -> np.ndarray:
    """Least squares by Gram matrices (..., k, k), the torque last: coefficients of some columns."""
    c = list(columns)
    matrix, right = gram[..., c, :][..., c], gram[..., c, -1]
    scale = np.sqrt(np.maximum(np.einsum("...ii->...i", matrix), 1e-300))
    matrix = matrix / scale[..., :, None] / scale[..., None, :] + 1e-10 * np.eye(len(c))
    found: np.ndarray = np.linalg.solve(matrix, (right / scale)[..., None])[..., 0] / scale
    return found


def solve_within(gram: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Least squares by a Gram matrix with coefficients between two ends, (2, k)."""
    wanted = solve(gram, range(len(gram) - 1))
    if ((ends[0] <= wanted) & (wanted <= ends[1])).all():
        return wanted
    scale = np.sqrt(np.maximum(np.diag(gram)[:-1], 1e-300))
    matrix = gram[:-1, :-1] / scale[:, None] / scale + 1e-10 * np.eye(len(scale))
    root = np.linalg.cholesky(matrix).T
    low, high = ends * scale
    found: np.ndarray = lsq_linear(root, root @ (wanted * scale), (low, high), "bvls").x / scale
    return found


def cost_of(gram: np.ndarray, columns: Sequence[int], coefficients: np.ndarray) -> np.ndarray:
    """Sum of squared residuals that these coefficients leave."""
    c = [*columns, gram.shape[-1] - 1]
    one = np.ones((*coefficients.shape[:-1], 1))
    v = np.concatenate((-coefficients, one), axis=-1)
    left: np.ndarray = np.einsum("...i,...ij,...j->...", v, gram[..., c, :][..., c], v)
    cost: np.ndarray = np.maximum(left, 0.0)
    return cost
