# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From the command to the open-circuit voltage of the amplifier: what a driver makes of it."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Drive:
    """
    The driver's static behaviour and its clock; SI units; neutral by default.

    The dynamics that need to know the load (pole, resistance, current limit) are in `Stack`.

    """

    # A driver with a clock of its own: it takes the newest command at each tick, and puts it out
    # a fixed latency later. Between the ticks it sees nothing.
    clock_period: float = 0.0  # s, 0 is none
    clock_phase: float = 0.0  # fraction of a period
    latency: float = 0.0  # s
    gain: float = 1.0
    offset: float = 0.0  # V
    curvature: float = 0.0  # V at 100 V, growing as the headroom below the supply shrinks
    supply: float = 120.0  # V, of the output stage
    upper_rail: float = np.inf  # V, soft
    knee: float = 1.0  # V that are missing where a perfect driver would just reach its rail
    resolution: float = 0.0  # V, missing bits of the converter
    warm_up: float = 0.0  # V
    warm_up_time: float = 10.0  # s


def output(drive, command, time):
    """Return the open-circuit voltage for commands that hold, at their times since the start."""
    u = np.asarray(command, dtype=float)
    if drive.resolution > 0.0:
        u = drive.resolution * np.round(u / drive.resolution)
    v = drive.gain * u + drive.offset
    if drive.curvature:
        # The loop gain goes with the headroom, so what it leaves of an error grows as one over it.
        headroom = np.maximum(drive.supply - u, 5.0)
        v = v + drive.curvature * (drive.supply - 100.0) / headroom * u / 100.0
    if np.isfinite(drive.upper_rail):
        # In its triode region a transistor carries drive times headroom. The load of the stage
        # needs as much as ever, so the error that drives it is knee^2 over the headroom.
        middle, half = 0.5 * (v + drive.upper_rail), 0.5 * (v - drive.upper_rail)
        v = middle - np.hypot(half, drive.knee)
    return v + drive.warm_up * (1.0 - np.exp(-np.asarray(time) / drive.warm_up_time))


def segments(drive, time, command, force):
    """
    Return boundaries (s + 1,), open-circuit voltages (s,) and forces (s,) of constant input.

    Parameters
    ----------
    drive : Drive
        What stands between command and terminals.
    time : (n,) array
        Row times in s; the last row's command never takes effect within the recording.
    command, force : (n,) array
        Volts and newtons, held from their row to the next.

    """
    if drive.clock_period > 0.0 or drive.latency > 0.0:
        taken = latched(drive, time)
        changes = np.concatenate([time[:-1], taken[0]])
        order = np.argsort(changes, kind='stable')
        starts = changes[order]
        starts = starts[np.concatenate([[True], np.diff(starts) > 1e-9])]
        starts = starts[(starts >= time[0]) & (starts < time[-1] - 1e-9)]
        # The command in force is that of the last tick; before the first it is that of rest.
        tick = np.searchsorted(taken[0], starts + 1e-9, side='right') - 1
        row = np.where(tick >= 0, taken[1][np.maximum(tick, 0)], 0)
        commands = np.where(tick >= 0, command[row], 0.0)
        forces = force[np.searchsorted(time, starts + 1e-9, side='right') - 1]
    else:
        starts, commands, forces = time[:-1], command[:-1], force[:-1]
    sources = output(drive, commands, starts - time[0])
    return np.append(starts, time[-1]), sources, np.asarray(forces, dtype=float)


def latched(drive, time):
    """Return when the output changes, and the row whose command it then follows."""
    if drive.clock_period > 0.0:
        first = time[0] + drive.clock_phase * drive.clock_period
        ticks = np.arange(first, time[-1], drive.clock_period)
        rows = np.searchsorted(time, ticks + 1e-9, side='right') - 1
        fresh = np.concatenate([[True], np.diff(rows) != 0])
        ticks, rows = ticks[fresh], rows[fresh]
    else:
        ticks, rows = time[:-1], np.arange(time.size - 1)
    return ticks + drive.latency, rows
