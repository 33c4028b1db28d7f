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
from dataclasses import dataclass, fields
import math

import numpy as np
from piezo_stack_sim.gap.measured.evidence import Track
from piezo_stack_sim.gap.measured.forward import Refined, simulate_channels
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording.recording import Recording
from scipy.ndimage import convolve1d

STANDS_OUT = 4.0  # standard deviations of a wavelet coefficient from which it is no noise
COARSEST = 16  # rows of the coarsest wavelet, of all rows at least this part
SPLINE = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
FINE = 8  # parts of a row in which the voltage between rows is filled in
QUICK, SETTLED = 8e-6, 250e-6  # s; parts after a jump, as quick as stacks swing, and until when
JUMP = 0.005  # part of the way of a recording that is a jump from one row to the next
MOST = 12000  # such parts of a recording, or none: every fit has to simulate them


@dataclass(frozen=True)
class MeasuredVoltage:
    """
    What was measured at the terminals of one recording, against what a driver makes of it.

    ``edges`` (k,) are places from which on the voltage is held, all rows among them and more in
    ``jumps``, the rows in which the command jumps; ``driven`` (2 k - 1,) is what the driver puts
    out at the ``places``, ``missed`` (n,) what stands above the noise of the measured voltage less
    that at the rows (V).
    """

    recording: Recording
    edges: np.ndarray
    jumps: np.ndarray
    driven: np.ndarray
    missed: np.ndarray

    @classmethod
    def of(cls, track: Track, driver: Device) -> MeasuredVoltage:
        """Look at a recording that was driven by voltage and measured it."""
        recording = track.recording
        rows = np.arange(len(recording))
        jumps = np.flatnonzero(np.abs(np.diff(recording.command, prepend=recording.start[0])[:-1])
                               > JUMP * np.ptp(recording.command))
        soon = _soon(recording.period)
        if jumps.size * soon.size > MOST:
            jumps = jumps[:0]
        edges = np.union1d(np.arange(rows[-1] * FINE + 1) / FINE, np.add.outer(jumps, soon))
        places = _with_middles(edges)
        held = places.astype(int)  # the row from which on a command holds
        driven = simulate(driver, np.interp(places, rows, recording.time),
                          recording.command[held], recording.external_force[held],
                          'voltage', start=recording.start,
                          before=recording.before).voltage
        at_rows = driven[2 * np.searchsorted(edges, rows)]
        return cls(recording, edges, jumps, driven, above_noise(
            recording.measured['voltage'] - at_rows, track.zero['voltage']))

    @property
    def places(self) -> np.ndarray:
        """Return the edges and the middle between each two, (2 k - 1,)."""
        return _with_middles(self.edges)

    @property
    def kept(self) -> np.ndarray:
        """Return which of the edges are rows, (n,)."""
        return np.searchsorted(self.edges, np.arange(len(self.recording)))

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
        moves = float(np.sum(np.diff(self.driven[2 * self.kept]) ** 2))
        return self.recording.period * math.sqrt(float(np.sum(alone ** 2)) / moves
                                                 ) if moves > 0.0 else 0.0

    def as_command(self) -> Recording:
        """
        Return the recording driven by its voltage, in the middle between a row and the next.

        Where it jumps it is given in parts of the row.
        """
        recording, rows = self.recording, np.arange(len(self.recording))
        middles = np.minimum(rows + 0.5, rows[-1])
        command = np.interp(middles, self.places, self._between())
        measured = {c: v for c, v in recording.measured.items() if c != 'voltage'}
        steps = recording.replace(command=command, measured=measured)
        if not self.jumps.size:
            return steps
        inside = np.isin(self.edges.astype(int), self.jumps)
        inside[self.kept] = True
        edges, held = self.edges[inside], self.edges[inside].astype(int)
        parts = self._parts(edges, np.where(
            np.isin(held, self.jumps), self._held()[inside], command[held]))
        return Refined(**{each.name: getattr(steps, each.name) for each in fields(steps)},
                       parts=parts, kept=np.searchsorted(edges, rows))

    def _between(self) -> np.ndarray:
        rows = np.arange(len(self.recording))
        return self.driven + np.interp(self.places, rows, self.missed)

    def _held(self) -> np.ndarray:
        """Return the voltage from each edge to the next (k,), the last once more."""
        return _from_edges(self._between())

    def _parts(self, edges: np.ndarray, command: np.ndarray) -> Recording:
        rows = np.arange(len(self.recording))
        return Recording(self.recording.name, np.interp(edges, rows, self.recording.time),
                         'voltage', command, self.recording.external_force[edges.astype(int)],
                         start=self.recording.start, before=self.recording.before)

    def answer_of(self, device: Device) -> dict[str, np.ndarray]:
        """Return what a device does that this voltage drives, channel to (n,), SI units."""
        return self._answer_to(device, self._held())

    def _answer_to(self, device: Device, command: np.ndarray) -> dict[str, np.ndarray]:
        """Return what a device does at the rows, (n,), by commands (k,) from edge to edge."""
        answer = simulate_channels(device, self._parts(self.edges, command))
        return {channel: values[self.kept] for channel, values in answer.items()}

    def otherwise(self, late: float) -> np.ndarray:
        """Return it from edge to edge (k,) as it may be, too: in steps, and ``late`` (s)."""
        rows = np.arange(len(self.recording))
        held = self.places.astype(int)
        command = _from_edges(self.driven + self.missed[np.minimum(held + 1, rows[-1])])
        if late <= 0.0:
            return command
        time = np.interp(self.edges, rows, self.recording.time)
        return np.interp(time - late, time, command)

    def strayed(self, device: Device, answer: Mapping[str, np.ndarray], late: float
                ) -> dict[str, np.ndarray]:
        """Return how far its answer may be off, (n,): for what is not known between the rows."""
        other = self._answer_to(device, self.otherwise(late))
        return {channel: other[channel] - values for channel, values in answer.items()}


def _soon(period: float) -> np.ndarray:
    """Return places after a jump, parts of a row that takes so long (s)."""
    step = 2.0 ** -max(0, math.ceil(math.log2(period / QUICK)))
    return np.arange(step, min(1.0, SETTLED / period), step)


def _with_middles(edges: np.ndarray) -> np.ndarray:
    """Return places (2 k - 1,): edges (k,) and the middle between each two."""
    places = np.empty(2 * edges.size - 1)
    places[::2], places[1::2] = edges, 0.5 * (edges[:-1] + edges[1:])
    return places


def _from_edges(values: np.ndarray) -> np.ndarray:
    """Return what holds from each edge to the next, (k,), of values at places (2 k - 1,)."""
    return np.append(values[1::2], values[-1])


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
