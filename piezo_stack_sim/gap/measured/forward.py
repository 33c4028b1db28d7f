# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From numbers to residuals: the simulation of all recordings of a set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.measured.evidence import Evidence
from piezo_stack_sim.plant import Device, replay, Timeline
from piezo_stack_sim.plant.analysis import natural_frequency, open_stiffness
from piezo_stack_sim.recording.recording import Recording
from scipy.signal import cont2discrete, lfilter

# Checked once, and forgotten with the recording: a fit replays it hundreds of times.
_TIMELINES: WeakKeyDictionary[Recording, Timeline] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False, repr=False)
class Refined(Recording):
    """
    A recording that is simulated in parts of its rows.

    ``parts`` holds time, command and force of these, ``kept`` (n,) which of them begin a row.
    """

    # The fields of a recording have defaults: so must these, which are always given.
    parts: Recording = None  # type: ignore[assignment]
    kept: np.ndarray = None  # type: ignore[assignment]


def simulate_channels(device: Device, recording: Recording) -> dict[str, np.ndarray]:
    """Return voltage (V), charge (C) and displacement (m) of a device on a recording, (n,)."""
    if isinstance(recording, Refined):
        answer = simulate_channels(device, recording.parts)
        return {channel: values[recording.kept] for channel, values in answer.items()}
    timeline = _TIMELINES.get(recording)
    if timeline is None:
        timeline = _TIMELINES[recording] = Timeline.of(
            recording.time, recording.command, recording.external_force, recording.start,
            recording.before)
    response = replay(device, timeline, recording.drive)
    return {'voltage': response.voltage, 'charge': response.charge,
            'displacement': _counted(response.displacement, recording)}


def _counted(displacement: np.ndarray, recording: Recording) -> np.ndarray:
    """
    Return a simulated displacement (m) as the recording counts it.

    What shakes the sensor shows in the first row already; a displacement that counts from there
    begins at zero all the same.
    """
    begins, measured = displacement[0], recording.measured.get('displacement')
    if begins == 0.0 or measured is None or abs(measured[0] - begins) < abs(measured[0]):
        return displacement
    return displacement - begins


def simulate_set(device: Device, recordings) -> list[dict[str, np.ndarray]]:
    """Simulate every recording of a set, over all cores."""
    return parallel(lambda recording: simulate_channels(device, recording), recordings)


def residuals(device: Device, evidence: Evidence) -> np.ndarray:
    """
    Return measured minus simulated over the noise, all tracks and channels in one vector.

    Returns
    -------
    ndarray, shape (N,)
        In the order of ``evidence.keys``.

    """
    def one(track):
        simulated = simulate_channels(device, track.recording)
        # A step of a fit may try a device that runs away: infinitely wrong, and no news to a user.
        with np.errstate(over='ignore'):
            return [track.weighted(c, simulated[c]) for c in track.channels]

    # The longest first: one that begins last would leave the other cores waiting.
    order = sorted(range(len(evidence.tracks)),
                   key=lambda i: -len(evidence.tracks[i].recording))
    rows = dict(zip(order, parallel(one, [evidence.tracks[i] for i in order])))
    return np.concatenate([row for i in range(len(order)) for row in rows[i]])


def residuals_of(evidence: Evidence, simulated: Sequence[dict[str, np.ndarray]]) -> np.ndarray:
    """Return the same, (N,), of outputs that are simulated already."""
    return np.concatenate([track.weighted(channel, answer[channel])
                           for track, answer in zip(evidence.tracks, simulated)
                           for channel in track.channels])


def settling_time(device: Device) -> float:
    """Return the time (s) in which the stack follows a command: half a period of its own."""
    return 0.5 / natural_frequency(device, open_stiffness(device))


def followed(evidence: Evidence, simulated: Sequence[dict[str, np.ndarray]],
             answer: tuple[Sequence[float], Sequence[float]], settles: float) -> np.ndarray:
    """
    Return how the residual changes by what only follows the displacement, without simulating it.

    Parameters
    ----------
    evidence : Evidence
        The recordings.
    simulated : sequence of dict
        What each recording shows without: channel to (n,).
    answer : pair of sequences of float
        Transfer function from the displacement to what is added to its reading: numerator and
        denominator, falling powers of s.
    settles : float
        Time (s) in which the stack follows a command.  Between rows further apart the displacement
        is taken for that of the later, which it is soon after the command; else for straight.

    Returns
    -------
    ndarray, shape (N,)
        In the order of ``evidence.keys``.

    """
    def change(key):
        i, channel = key
        track, values = evidence.tracks[i], simulated[i][channel]
        if channel != 'displacement':
            return np.zeros(track.measured[channel].size)
        held = track.recording.period > settles
        numerator, denominator, _ = cont2discrete(
            answer, track.recording.period, 'zoh' if held else 'foh')
        numerator = np.ravel(numerator)
        ahead = np.append(values[1:], values[-1]) if held else values
        added = lfilter(numerator, denominator, ahead - values[0])
        # What is felt at once is of the row itself.
        added += numerator[0] * (values - ahead)
        return track.weighted(channel, values + added) - track.weighted(channel, values)

    return np.concatenate([change(key) for key in evidence.keys])


def spans(evidence: Evidence) -> list[slice]:
    """Return where each (track, channel) lies in a residual vector."""
    result, start = [], 0
    for i, channel in evidence.keys:
        size = evidence.tracks[i].measured[channel].size
        result.append(slice(start, start + size))
        start += size
    return result


def fitted_rows(evidence: Evidence) -> np.ndarray:
    """Return which entries of a residual vector a fit may see, shape (N,)."""
    return np.concatenate([evidence.tracks[i].fitted for i, _ in evidence.keys])
