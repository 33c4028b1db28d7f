# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""How well a displacement follows a reference, and how wide the loop over the command is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

HEIGHT = 10e-6  # m, the first and highest peak
# Driven by positive voltages alone the stack does not come all the way back: the valleys lie above
# what is left at 0 V.
VALLEY = 3e-6  # m
WAVES = 5
SWING = 0.25  # s from valley to peak; slow against the resonance: what shows is hysteresis


def reference(rate: float, waves: int = WAVES) -> np.ndarray:
    """
    Return a smooth way from rest through peaks of falling height.

    Parameters
    ----------
    rate : float
        Samples per second (Hz).
    waves : int
        Number of peaks.

    Returns
    -------
    numpy.ndarray, shape (n,)
        Displacement wanted at each sample, the first of them 0 (m).

    """
    turns = [0.0]
    for wave in range(waves):
        turns += [HEIGHT - 0.6 * (HEIGHT - VALLEY) * wave / waves, VALLEY]
    phase = np.arange(round(2 * waves * SWING * rate) + 1) / (SWING * rate)
    swing = np.minimum(phase.astype(int), 2 * waves - 1)
    begin, end = np.array(turns)[swing], np.array(turns)[swing + 1]
    return begin + (end - begin) * 0.5 * (1.0 - np.cos(np.pi * (phase - swing)))


@dataclass(frozen=True)
class Run:
    """What one controller did: reference (m), command (V or C) and displacement (m), (n,) each."""

    name: str
    rate: float  # Hz
    delay: int  # samples until a command shows
    reference: np.ndarray
    command: np.ndarray
    displacement: np.ndarray

    @property
    def time(self) -> np.ndarray:
        """Return the time of each sample (s)."""
        return np.arange(self.reference.size) / self.rate

    @property
    def error(self) -> np.ndarray:
        """Return what is missing to the reference (m)."""
        return self.reference - self.displacement

    @property
    def rms_error(self) -> float:
        """Return the root mean square of the error (m)."""
        return float(np.sqrt(np.mean(self.error ** 2)))

    @property
    def peak_error(self) -> float:
        """Return the largest error (m)."""
        return float(np.abs(self.error).max())

    @property
    def loop_width(self) -> float:
        """
        Return the width of the displacement-over-command loop as a fraction of its stroke.

        The largest difference between the way down from the first peak and the
        way up to the second one, at equal command.

        """
        swing = round(self.rate * SWING)
        command, displacement = self.command[:-self.delay], self.displacement[self.delay:]
        down, up = slice(swing, 2 * swing), slice(2 * swing, 3 * swing)
        grid = np.linspace(max(command[down].min(), command[up].min()),
                           min(command[down].max(), command[up].max()), 200)
        falling = np.interp(grid, np.maximum.accumulate(command[down][::-1]),
                            displacement[down][::-1])
        rising = np.interp(grid, np.maximum.accumulate(command[up]), displacement[up])
        return float(np.abs(falling - rising).max() / np.ptp(displacement[down]))


def removed(before: Run, after: Run) -> float:
    """Return the fraction of one run's RMS error that is gone in another."""
    return 1.0 - after.rms_error / before.rms_error


def table(runs: list[Run]) -> str:
    """Return the runs as a table for a terminal."""
    width = max(len(run.name) for run in runs)
    rows = [f'{"":{width}}  {"RMS error":>19}  {"largest error":>19}  {"loop width":>10}']
    for run in runs:
        stroke = np.ptp(run.reference)
        cells = [f'{size * 1e9:8.1f} nm {size / stroke:6.2%}'
                 for size in (run.rms_error, run.peak_error)]
        rows.append(f'{run.name:{width}}  {cells[0]:>19}  {cells[1]:>19}  {run.loop_width:10.2%}')
    return '\n'.join(rows)
