# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recordings ready to be fitted: averaged, weighted, without the rows that were mended."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from piezo_stack_sim.gap.measured.forward import simulate_channels
from piezo_stack_sim.identify.vector import Layout
from piezo_stack_sim.recording.recording import MEASURED, Recording

ROWS = 8000  # a recording is averaged down to about this many rows
UNIT_CHANGES = tuple(sign * 10.0 ** (3 * power) for power in (0, -1, -2, -3, -4, 1, 2, 3)
                     for sign in (1.0, -1.0))  # what preflight may do to a whole channel
FLOOR = 1e-5  # of the span: nothing is weighed as if it were known better


@dataclass(frozen=True)
class Track:
    """
    One recording as the fit sees it.

    ``number`` is its place in the set; ``measured`` and ``used`` map a channel to
    (m,) averages and to whether each may be used, ``sigma`` to the standard
    deviation that weighs it.
    """

    number: int
    recording: Recording
    factor: int
    measured: dict[str, np.ndarray]
    used: dict[str, np.ndarray]
    sigma: dict[str, float]

    def average(self, values) -> np.ndarray:
        """Average (n,) values over neighbouring rows to (m,)."""
        m = len(values) // self.factor
        return np.asarray(values)[:m * self.factor].reshape(m, self.factor).mean(axis=1)

    def misfit(self, simulated) -> dict[str, np.ndarray]:
        """
        Return measured minus simulated (m,) of each channel, freed of a constant offset.

        Sensors are zeroed somewhere; their offset is no property of the device.
        """
        result = {}
        for channel, measured in self.measured.items():
            rest = measured - self.average(simulated[channel])
            used = self.used[channel]
            result[channel] = np.where(used, rest - rest[used].mean(), 0.0)
        return result


def make_tracks(recordings, originals) -> list[Track]:
    """
    Prepare recordings for fitting.

    Parameters
    ----------
    recordings : sequence of Recording
        After preflight.
    originals : mapping of str to Recording
        The same before preflight, by name: values that preflight invented are not fitted.

    Returns
    -------
    list of Track

    """
    spans = {c: max((np.ptp(r.measured[c]) for r in recordings if c in r.measured), default=0.0)
             for c in MEASURED}
    tracks = []
    for recording in recordings:
        track = Track(len(tracks), recording, max(1, round(len(recording) / ROWS)), {}, {}, {})
        for channel in _telling(recording):
            values = recording.measured[channel]
            track.measured[channel] = track.average(values)
            bad = _invented(recording, originals.get(recording.name), channel)
            track.used[channel] = track.average(bad) == 0.0
            track.sigma[channel] = 0.01 * max(np.ptp(values), 0.01 * spans[channel])
        if track.measured:
            tracks.append(track)
    return tracks


def _telling(recording) -> list[str]:
    """Return the measured channels that the drive does not fix."""
    fixed = {'voltage': 'voltage', 'shorted': 'voltage', 'charge': 'charge', 'open': 'charge'}
    return [c for c in MEASURED if c in recording.measured and c != fixed[recording.drive]
            and np.ptp(recording.measured[c]) > 0.0]


def _invented(recording, original, channel) -> np.ndarray:
    """Return 1.0 where preflight changed a value beyond an offset, a sign or a unit."""
    after = recording.measured[channel]
    none = np.zeros(after.size)
    if original is None or channel not in original.measured or recording.rows is None \
            or original.rows is None:
        return none
    rows = original.rows
    order = np.argsort(rows, kind='stable')
    place = order[np.minimum(np.searchsorted(rows[order], recording.rows), rows.size - 1)]
    before = original.measured[channel][place]
    new = (rows[place] != recording.rows) | ~np.isfinite(before)
    known = np.flatnonzero(~new)
    if known.size < 3:
        return none
    # Sign, unit and offset change all rows alike; what is left was changed by itself.
    fewest, slopes = None, UNIT_CHANGES
    if recording.arbitrary and channel == 'displacement':
        ends = known[[np.argmin(before[known]), np.argmax(before[known])]]
        slopes = (*slopes, float(np.ptp(after[ends]) / max(np.ptp(before[ends]), 1e-300)))
        slopes = (*slopes, -slopes[-1])
    for slope in slopes:
        rest = after - slope * np.where(new, 0.0, before)
        changed = np.abs(rest - np.median(rest[known])) > 1e-6 * np.ptp(after)
        if fewest is None or changed[known].sum() < fewest[known].sum():
            fewest = changed
    return np.where(new | fewest, 1.0, none)


def misfits(layout: Layout, vector, tracks) -> list[dict[str, np.ndarray]]:
    """Return the misfit of every track (SI units)."""
    return [track.misfit(simulate_channels(layout.device_for(vector, track.number),
                                           track.recording)) for track in tracks]


def weighted(tracks, misfit) -> np.ndarray:
    """Return all misfits over their sigma in one vector, (N,)."""
    return np.concatenate([values / track.sigma[channel]
                           for track, each in zip(tracks, misfit)
                           for channel, values in each.items()])


def blocks(tracks) -> list[tuple[Track, str, slice]]:
    """Return where each channel of each track lies in a weighted vector."""
    result, start = [], 0
    for track in tracks:
        for channel, values in track.measured.items():
            result.append((track, channel, slice(start, start + values.size)))
            start += values.size
    return result


def reweighted(tracks, misfit) -> list[Track]:
    """Return the tracks weighed by what a fit left of each channel of each."""
    result = []
    for track, rest in zip(tracks, misfit):
        sigma = {}
        for channel, values in rest.items():
            used = track.used[channel]
            floor = FLOOR * np.ptp(track.measured[channel])
            sigma[channel] = float(max(np.sqrt(np.mean(values[used] ** 2)), floor))
        result.append(replace(track, sigma=sigma))
    return result
