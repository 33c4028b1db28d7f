# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Recordings that were made one after the other, without relaxing the device in between.

The hysteresis remembers the largest swings of what went before (Eq. 16), so that a recording
may begin where another has left the device, its sensors zeroed there.  That is no effect of the
device: it is simulated so.  Each recording is asked after which other it fits; that is believed
only if some of them began relaxed, from which all others follow, and if little is left of what
was wrong, much less than if they all began relaxed, a factor for each channel aside: what a
spring or a sensor takes from every stroke looks like that.  Where none began relaxed it is the
effect ``initial_polarisation``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.measured.forward import simulate_channels
from piezo_stack_sim.plant import Device
from piezo_stack_sim.recording.finding import Finding, found, NOTE
from piezo_stack_sim.recording.recording import Recording

FOLLOWS = 0.25  # part of the error of a relaxed start that one which follows another may leave
LEFT = 0.03  # part of the range that may be wrong then, rms: a unit differs from its file
RELAXED = 0.7  # and part that the best other start of one that began relaxed must leave
CLEARLY = 0.9  # part of the error that another way there may leave
MOST = 8  # recordings of a set that are asked


def in_succession(recordings: Sequence[Recording], device: Device,
                  simulated: Sequence[dict[str, np.ndarray]]
                  ) -> tuple[tuple[Recording, ...], list[Finding]]:
    """
    Return recordings with what was before them, where they follow each other, and what was found.

    Parameters
    ----------
    recordings : sequence of Recording
        After preflight.
    device : Device
        The simulation.
    simulated : sequence of dict
        Channel to (n,) array for each of them, begun relaxed.

    """
    same = tuple(recordings), []
    if not 1 < len(recordings) <= MOST or any(
            each.drive != 'voltage' or each.arbitrary or each.start[0] for each in recordings):
        return same
    relaxed = [_error(each, answer) for each, answer in zip(recordings, simulated)]
    swings = [extremes(each.command) for each in recordings]
    jobs = [(i, j) for i in range(len(recordings)) for j in range(len(recordings)) if i != j]

    def ask(job):
        i, j = job
        after = recordings[i].replace(before=swings[j])
        return _error(after, simulate_channels(device, after))

    errors = dict(zip(jobs, parallel(ask, jobs)))
    leader: dict[int, int] = {}
    for i, error in enumerate(relaxed):
        best = min((j for j in range(len(recordings)) if j != i), key=lambda j: errors[i, j])
        if errors[i, best] < FOLLOWS * error:
            if errors[i, best] > LEFT ** 2:
                return same  # something else is wrong, which a start cannot tell
            leader[i] = best
        elif errors[i, best] < RELAXED * error:
            return same  # neither here nor there
    past = _pasts(leader, swings)
    if not leader or len(past) < len(recordings):
        return same  # all of them alike, or some in a circle: none of these began relaxed
    past = _through_others(recordings, device, swings, leader, past)
    followed = tuple(each.replace(before=past[i]) for i, each in enumerate(recordings))
    answers = parallel(lambda each: simulate_channels(device, each), followed)
    if (_left_by_a_factor(followed, answers)
            > FOLLOWS * _left_by_a_factor(recordings, simulated)):
        return same  # a unit, or a load, of which all that it does is less or more
    findings = [found(recordings[i], None, NOTE, 'begins with what '
                      f'{recordings[j].name} left in the device',
                      'it is simulated from there; relax the device before each recording to '
                      'leave no doubt') for i, j in sorted(leader.items())]
    return followed, findings


def _pasts(leader: dict[int, int], swings: Sequence[tuple[float, ...]]
           ) -> dict[int, tuple[float, ...]]:
    """Return what was before each recording that follows one that began relaxed, or is one."""
    past: dict[int, tuple[float, ...]] = {
        i: () for i in range(len(swings)) if i not in leader}
    while True:
        ready = [i for i, j in leader.items() if i not in past and j in past]
        if not ready:
            return past
        past |= {i: (*past[leader[i]], *swings[leader[i]]) for i in ready}


def _through_others(recordings, device, swings, leader, past) -> dict[int, tuple[float, ...]]:
    """Let followers come after another follower, with all that was before it, if that fits."""
    for i in sorted(leader):
        others = [j for j in leader if j != i and not _comes_after(j, i, leader)]

        def ask(j, i=i, past=past):
            after = recordings[i].replace(
                before=past[i] if j == i else (*past[j], *swings[j]))
            return _error(after, simulate_channels(device, after))

        errors = dict(zip([i, *others], parallel(ask, [i, *others])))
        best = min(errors, key=lambda j: errors[j])
        if best != i and errors[best] < CLEARLY * errors[i]:
            leader[i] = best
            past = _pasts(leader, swings)
    return past


def _comes_after(one: int, other: int, leader: dict[int, int]) -> bool:
    """Tell whether one recording follows another, directly or not."""
    while one in leader:
        one = leader[one]
        if one == other:
            return True
    return False


def extremes(command: np.ndarray) -> tuple[float, ...]:
    """
    Return the turning points of a command, shape (n,), that its hysteresis remembers.

    A swing within a larger one later on is forgotten (Madelung's rules, as the play operators of
    Eq. 16 keep them).  The last value is among them.
    """
    kept = [0.0]  # relaxed
    for point in map(float, command[np.append(np.diff(command) != 0.0, True)]):
        while len(kept) > 1:
            last = kept[-1] - kept[-2]
            if (point - kept[-1]) * last >= 0.0:
                del kept[-1]  # it goes on
            elif len(kept) > 2 and abs(last) <= min(abs(point - kept[-1]),
                                                    abs(kept[-2] - kept[-3])):
                del kept[-2:]  # the last swing lies within the one before and this one
            else:
                break
        kept.append(point)
    return tuple(kept)


def _error(recording: Recording, simulated: dict[str, np.ndarray]) -> float:
    """Return the power of what is wrong with charge and displacement, in parts of their range."""
    powers = [float(np.mean((measured - answer) ** 2))
              for measured, answer in _moves(recording, simulated).values()]
    return sum(powers) / max(len(powers), 1)


def _left_by_a_factor(recordings: Sequence[Recording],
                      simulated: Sequence[dict[str, np.ndarray]]) -> float:
    """Return the sum of the errors if each channel, in all recordings, is off by one factor."""
    moves = [_moves(*pair) for pair in zip(recordings, simulated)]
    total = 0.0
    for channel in sorted({channel for each in moves for channel in each}):
        pairs = [(*each[channel], len(each)) for each in moves if channel in each]
        factor = (sum(float(np.mean(measured * answer)) / n for measured, answer, n in pairs)
                  / max(sum(float(np.mean(answer ** 2)) / n for _, answer, n in pairs), 1e-300))
        total += sum(float(np.mean((measured - factor * answer) ** 2)) / n
                     for measured, answer, n in pairs)
    return total


def _moves(recording: Recording, simulated: dict[str, np.ndarray]
           ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return charge and displacement, measured and simulated, since the start, over the range."""
    moves = {}
    for channel, values in recording.measured.items():
        if channel != 'voltage':
            # The zero of both is that of the first samples of their difference.
            zero = np.median((values - simulated[channel])[:5])
            begun, span = simulated[channel][0], float(np.ptp(values)) or 1.0
            moves[channel] = ((values - zero - begun) / span,
                              (simulated[channel] - begun) / span)
    return moves
