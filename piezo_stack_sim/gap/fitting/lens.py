# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What of a residual a fit looks at: plain rows, or cells of time and frequency.

No library holds the true form of an effect, and what the form of one misses is
mostly louder than a second effect.  But it is loud at some times and in some
bands only: in short blocks and octaves a weak second effect stands out where
the first has been explained.  What to expect in a cell is told by
:mod:`piezo_stack_sim.gap.fitting.form`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from piezo_stack_sim.gap.measured.apart import Apart
from piezo_stack_sim.gap.measured.evidence import Evidence
from piezo_stack_sim.gap.measured.forward import spans
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
        self.apart = Apart(evidence)
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

    def of(self, spectrum: np.ndarray) -> list[np.ndarray]:
        """Return the mean square of coefficients (M,) in cells: (blocks, octaves) by track."""
        result, start = [], 0
        for rows in self.blocks:
            sort, size = _octaves(rows.shape[1])
            part = spectrum[start:start + rows.size].reshape(rows.shape)
            start += rows.size
            result.append(part ** 2 @ sort / size)
        return result

    def sizes(self) -> list[np.ndarray]:
        """Return how many coefficients there are in the cells of a block: (octaves,) by track."""
        return [_octaves(rows.shape[1])[1] for rows in self.blocks]

    def over(self, cells: list[np.ndarray]) -> np.ndarray:
        """Return numbers of the cells, (blocks, octaves) by track, at every coefficient (M,)."""
        return np.concatenate([(each @ _octaves(rows.shape[1])[0].T).ravel()
                               for each, rows in zip(cells, self.blocks)])

    def spectrum(self, values: np.ndarray) -> np.ndarray:
        """
        Return orthonormal cosine coefficients (M,) or (M, k) of values (N,) or (N, k).

        What charge moves is taken off the displacement.
        """
        values = self.apart(values)
        return np.concatenate([
            dct(values[rows], axis=1, norm='ortho').reshape(rows.size, *values.shape[1:])
            for rows in self.blocks])

    def powers(self, spectrum: np.ndarray) -> np.ndarray:
        """Return the mean square about every coefficient (M,), no less than that of the noise."""
        smooth = []
        for power, size in zip(self.of(spectrum), self.sizes()):
            total, count = power * size, len(power)
            power = np.empty_like(total)
            for k, coefficients in enumerate(size):
                around = int(np.ceil((STEADY / coefficients - 1.0) / 2.0))
                window = np.ones(min(2 * max(around, 0) + 1, count))
                power[:, k] = (np.convolve(total[:, k], window, 'same')
                               / np.convolve(np.full(count, coefficients), window, 'same'))
            smooth.append(power)
        return np.maximum(self.over(smooth), 1.0)

    def nats(self, residual: np.ndarray) -> float:
        """Return what a residual (N,) loses in log likelihood if the power of no cell is known."""
        return 0.5 * float(np.sum(np.log(self.powers(self.spectrum(residual)))))


@lru_cache
def _octaves(length: int) -> tuple[np.ndarray, np.ndarray]:
    """Return which coefficient is in which octave (length, octaves), and how many are in each."""
    octave = np.frexp(np.arange(length))[1]
    sort = np.eye(octave[-1] + 1)[octave]
    return sort, sort.sum(axis=0)


def weighed(cells: Cells, weight: np.ndarray) -> Lens:
    """Return the lens that shows the cosine coefficients of residuals times a weight (M,)."""
    def look(values: np.ndarray) -> np.ndarray:
        seen = cells.spectrum(values)
        return seen * (weight if values.ndim == 1 else weight[:, None])

    return look
