# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What of a residual a fit looks at: plain rows, or what stands out where little is left.

No library holds the true form of an effect, and what the form of one misses is
mostly louder than a second effect.  But it is loud at some times and in some
bands only.  Seen in short blocks and octaves, each weighed by what is left in
it, a weak second effect stands out where the first has been explained.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from piezo_stack_sim.gap.evidence import Evidence
from piezo_stack_sim.gap.forward import spans
from scipy.fft import dct

BLOCKS = 4  # to a stretch of rows
STEADY = 8  # coefficients from which the power of a cell is told
Lens = Callable[[np.ndarray], np.ndarray]


def plain(rows: np.ndarray) -> Lens:
    """Return the lens that shows some rows as they are."""
    return lambda values: values[rows]


class Cells:
    """
    The rows of a fit, or those withheld, in cells of a block of time and an octave.

    Parameters
    ----------
    evidence : Evidence
        What residuals belong to.
    fitted : bool
        Whether the rows that fits may see, or the others.

    """

    def __init__(self, evidence: Evidence, fitted: bool) -> None:
        self.blocks = []
        for (i, _), where in zip(evidence.keys, spans(evidence)):
            inside = np.flatnonzero(np.diff(np.concatenate(
                [[0], evidence.tracks[i].fitted == fitted, [0]])))
            starts, ends = inside[::2], inside[1::2]
            if not starts.size:
                continue  # too short to withhold anything
            length = max(1, int((ends - starts).min()) // BLOCKS)
            begin = np.concatenate([np.arange(a, b - length + 1, length)
                                    for a, b in zip(starts, ends)])
            self.blocks.append(where.start + begin[:, None] + np.arange(length))

    def spectrum(self, values: np.ndarray) -> np.ndarray:
        """Return orthonormal cosine coefficients (M,) or (M, k) of values (N,) or (N, k)."""
        return np.concatenate([
            dct(values[rows], axis=1, norm='ortho').reshape(rows.size, *values.shape[1:])
            for rows in self.blocks])

    def powers(self, spectrum: np.ndarray) -> np.ndarray:
        """Return the mean square about every coefficient (M,), no less than that of the noise."""
        result, start = [], 0
        for rows in self.blocks:
            count, length = rows.shape
            octave = np.frexp(np.arange(length))[1]
            sort = np.eye(octave[-1] + 1)[octave]  # (length, octaves)
            part = spectrum[start:start + rows.size].reshape(count, length)
            start += rows.size
            total, size = part ** 2 @ sort, sort.sum(axis=0)
            power = np.empty_like(total)
            for k, coefficients in enumerate(size):
                around = int(np.ceil((STEADY / coefficients - 1.0) / 2.0))
                window = np.ones(min(2 * max(around, 0) + 1, count))
                power[:, k] = (np.convolve(total[:, k], window, 'same')
                               / np.convolve(np.full(count, coefficients), window, 'same'))
            result.append((power @ sort.T).ravel())
        return np.maximum(np.concatenate(result), 1.0)

    def nats(self, residual: np.ndarray) -> float:
        """Return what a residual (N,) loses in log likelihood if the power of no cell is known."""
        return 0.5 * float(np.sum(np.log(self.powers(self.spectrum(residual)))))


def whitened(cells: Cells, residual: np.ndarray) -> Lens:
    """Return the lens that weighs every cell by what a residual (N,) leaves in it."""
    weight = 1.0 / np.sqrt(cells.powers(cells.spectrum(residual)))

    def look(values: np.ndarray) -> np.ndarray:
        seen = cells.spectrum(values)
        return seen * (weight if values.ndim == 1 else weight[:, None])

    return look
