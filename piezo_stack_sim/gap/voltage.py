# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The voltage at the terminals as a command to what lies behind them.

Its sensor is noisy, and hysteresis remembers every peak of a noise; and between
two rows it was not measured.  It is taken for what a driver makes of the
command, plus what stands above the noise of the difference at the rows.

What is driven by it in steps of a row is late by half of one, and swings after
every step: in fits that is taken off once, as steps of a small part of a row tell it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math

import numpy as np
from piezo_stack_sim.gap.evidence import Track
from piezo_stack_sim.gap.forward import simulate_channels
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording.recording import Recording
from scipy.ndimage import convolve1d

STANDS_OUT = 4.0  # standard deviations of a wavelet coefficient from which it is no noise
COARSEST = 16  # rows of the coarsest wavelet, of all rows at least this part
SPLINE = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
FINE = 8  # parts of a row in which the voltage between rows is filled in
PARTS = 2 * FINE  # and in which the driver is simulated


@dataclass(frozen=True)
class MeasuredVoltage:
    """
    What was measured at the terminals of one recording, against what a driver makes of it.

    ``fine`` (r,) are places between the rows, ``FINE`` and as many halves to each, ``driven`` (r,)
    what the driver puts out there (V), ``missed`` (n,) what stands above the noise of the measured
    voltage less that at the rows (V).
    """

    recording: Recording
    fine: np.ndarray
    driven: np.ndarray
    missed: np.ndarray

    @classmethod
    def of(cls, track: Track, driver: Device) -> MeasuredVoltage:
        """Look at a recording that was driven by voltage and measured it."""
        recording = track.recording
        fine = np.arange((len(recording) - 1) * PARTS + 1) / PARTS
        held = fine.astype(int)
        driven = simulate(driver, np.interp(fine, np.arange(len(recording)), recording.time),
                          recording.command[held], recording.external_force[held],
                          'voltage').voltage
        return cls(recording, fine, driven, above_noise(
            recording.measured['voltage'] - driven[::PARTS], track.zero['voltage']))

    @property
    def jitter(self) -> float:
        """
        Return by how much the driver comes early or late from row to row (s), rms.

        As what it misses in one row and not beside it, against how fast the voltage moves: a clock
        of its own, that of another computer.  A wrong form or gain is as wrong in the next row.
        The median takes some of it away, so that this is rather too little: two thirds in a test.
        """
        three = np.stack([self.missed[:-2], self.missed[1:-1], self.missed[2:]])
        alone = self.missed[1:-1] - np.median(three, axis=0)
        moves = float(np.sum(np.diff(self.driven[::PARTS]) ** 2))
        return self.recording.period * math.sqrt(float(np.sum(alone ** 2)) / moves
                                                 ) if moves > 0.0 else 0.0

    def as_command(self) -> Recording:
        """Return the recording driven by its voltage, in the middle between a row and the next."""
        between = self._between()
        measured = {c: v for c, v in self.recording.measured.items() if c != 'voltage'}
        return self.recording.replace(command=np.append(between[FINE::PARTS], between[-1]),
                                      measured=measured)

    def _between(self) -> np.ndarray:
        return self.driven + np.interp(self.fine, np.arange(len(self.recording)), self.missed)

    def answer_of(self, device: Device) -> dict[str, np.ndarray]:
        """Return what a device does that this voltage drives, channel to (n,), SI units."""
        between = self._between()
        return self._rows(device, np.append(between[1::2], between[-1]))

    def _rows(self, device: Device, command: np.ndarray) -> dict[str, np.ndarray]:
        """Return what a device does at the rows, (n,), by commands to ``FINE`` parts of them."""
        held = self.fine[::2].astype(int)
        time = np.interp(self.fine[::2], np.arange(len(self.recording)), self.recording.time)
        answer = simulate_channels(device, Recording(
            self.recording.name, time, 'voltage', command, self.recording.external_force[held]))
        return {channel: values[::FINE] for channel, values in answer.items()}

    def otherwise(self, late: float) -> np.ndarray:
        """Return it in ``FINE`` parts of a row as it may be, too: in steps, and ``late`` (s)."""
        held = self.fine.astype(int)
        rows = np.arange(len(self.recording))
        steps = self.driven + self.missed[np.minimum(held + 1, rows[-1])]
        command = np.append(steps[1::2], steps[-1])
        if late <= 0.0:
            return command
        time = np.interp(self.fine[::2], rows, self.recording.time)
        return np.interp(time - late, time, command)

    def strayed(self, device: Device, answer: Mapping[str, np.ndarray], late: float
                ) -> dict[str, np.ndarray]:
        """Return how far its answer may be off, (n,): for what is not known between the rows."""
        other = self._rows(device, self.otherwise(late))
        return {channel: other[channel] - values for channel, values in answer.items()}


def above_noise(values: np.ndarray, noise: float) -> np.ndarray:
    """
    Return what of a signal stands above white noise: its wavelet coefficients that do.

    Parameters
    ----------
    values : ndarray, shape (n,)
        The signal with its noise.
    noise : float
        Standard deviation of the noise, in the same unit.

    Returns
    -------
    ndarray, shape (n,)
        Zero where nothing but noise was there.  The wavelets are those of the
        undecimated B3 spline transform (Starck and Murtagh 2006, section 2.3).

    """
    def clear(part, impulse):
        loud = np.abs(part) > STANDS_OUT * noise * np.linalg.norm(impulse)
        return np.where(loud, part, 0.0)

    result = np.zeros_like(values)
    impulse = np.zeros(values.size)
    impulse[values.size // 2] = 1.0
    scale = 1
    while scale * COARSEST < values.size:
        spline = np.zeros(4 * scale + 1)
        spline[::scale] = SPLINE
        smooth = convolve1d(values, spline, mode='nearest')
        blurred = convolve1d(impulse, spline, mode='constant')
        result += clear(values - smooth, impulse - blurred)
        values, impulse, scale = smooth, blurred, 2 * scale
    return result + clear(values, impulse)
