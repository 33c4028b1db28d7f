# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The voltage at the terminals as a command to what lies behind them.

Its sensor is noisy, and hysteresis remembers every peak of a noise; and between
two rows it was not measured.  It is taken for what a driver makes of the
command, plus what stands above the noise of the difference at the rows.
"""

from __future__ import annotations

import numpy as np
from piezo_stack_sim.gap.evidence import Track
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording.recording import Recording
from scipy.ndimage import convolve1d

STANDS_OUT = 4.0  # standard deviations of a wavelet coefficient from which it is no noise
COARSEST = 16  # rows of the coarsest wavelet, of all rows at least this part
SPLINE = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0
FINE = 4  # parts of a row in which the voltage between rows is filled in, to see what it matters


def driven_by_voltage(track: Track, driver: Device) -> tuple[Recording, Recording]:
    """
    Return a recording driven by its measured voltage, and another way to fill that in.

    Parameters
    ----------
    track : Track
        Of a recording that was driven by voltage and measured it.
    driver : Device
        What makes a voltage of the command, as well as is known.

    Returns
    -------
    recording, finer : Recording
        The first holds from each row the voltage in the middle between it and the next, the
        second has ``FINE`` rows for one and holds what the driver misses.

    """
    recording = track.recording
    rows = np.arange(len(recording))
    parts = 2 * FINE
    fine = np.arange((len(recording) - 1) * parts + 1) / parts
    time = np.interp(fine, rows, recording.time)
    held = fine.astype(int)
    force = recording.external_force[held]
    driven = simulate(driver, time, recording.command[held], force, 'voltage').voltage
    missed = above_noise(recording.measured['voltage'] - driven[::parts],
                         track.zero['voltage'])
    between = driven + np.interp(fine, rows, missed)
    steps = driven + missed[np.minimum(held + 1, rows[-1])]
    measured = {c: v for c, v in recording.measured.items() if c != 'voltage'}
    coarse = np.append(between[FINE::parts], between[-1])
    return recording.replace(command=coarse, measured=measured), Recording(
        recording.name, time[::2], 'voltage', np.append(steps[1::2], steps[-1]), force[::2])


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
