# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What to measure next: the experiment that separates tied causes best, by simulation.

Each tied cause, as it was fitted, is a device.  Every profile of
``piezo_stack excite`` is played to all of them, with the channels at hand and
with one more; the distance of the two closest, over the noise, is what an
experiment is worth.  Where the recordings asked nothing every effect is a
cause yet, and an experiment is worth what it shows of them.
"""

from __future__ import annotations

import itertools

import numpy as np

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.deciding.isolability import SEEN
from piezo_stack_sim.gap.fitting.fit import Fitter
from piezo_stack_sim.gap.measured.evidence import CHANNELS, Evidence
from piezo_stack_sim.gap.measured.forward import simulate_channels
from piezo_stack_sim.gap.quantities import significant
from piezo_stack_sim.recording import programmes
from piezo_stack_sim.recording.recording import Recording

USUAL_NOISE = {'voltage': 5e-3, 'charge': 5e-9, 'displacement': 2e-9}
MOST = 5  # tied causes that are compared
HIGHEST = 90.0  # V that the profiles reach, if the device may be given as much
AVERAGE = 10  # rows averaged, as a slow difference is what noise cannot hide


def profiles(limit: float = HIGHEST) -> list[tuple[str, dict, Recording]]:
    """
    Return the experiments there are to choose from: profile, settings, commands.

    Parameters
    ----------
    limit : float
        Highest voltage (V) that the device may be given.

    """
    def volts(*levels):
        return [level * min(1.0, limit / HIGHEST) for level in levels]

    chosen = [
        ('triangle', {'peaks': volts(30.0, 60.0, 90.0), 'frequency': 10.0, 'rate': 10e3}),
        ('triangle', {'peaks': volts(20.0, 90.0), 'frequency': 1.0, 'rate': 1000.0}),
        ('triangle', {'peaks': volts(90.0), 'frequency': 100.0, 'cycles': 4, 'rate': 20e3}),
        ('steps', {'levels': volts(0.0, 60.0, 20.0, 80.0, 10.0), 'hold': 20.0, 'rate': 200.0}),
        ('multisine', {'bias': volts(40.0)[0], 'peak': volts(6.0)[0], 'band': [20.0, 5000.0],
                       'rate': 50e3}),
        ('force', {'bias': volts(40.0)[0], 'squeeze': 120.0, 'rate': 10e3}),
    ]
    return [(profile, settings, programmes.PROGRAMMES[profile](**settings))
            for profile, settings in chosen]


def next_experiment(fitter: Fitter, evidence: Evidence, tied: dict) -> dict | None:
    """
    Return the ``next_experiment`` part of a diagnosis, or None.

    Parameters
    ----------
    fitter : Fitter
        Of the set.
    evidence : Evidence
        What was measured, for its channels and noise.
    tied : dict of str to Fit
        The causes, or the pairs of causes, that the recordings do not decide between.

    """
    names = list(tied)[:MOST]
    if len(names) < 2:
        return None
    parts = [name.split('+') for name in names]
    told = list(dict.fromkeys(  # what all have in common is not told apart
        part for each in parts for part in each if not all(part in other for other in parts)))
    devices = [fitter.device_with(tied[name].effects, tied[name].phi) for name in names]
    noise = _noise(evidence)
    have = evidence.channels
    candidates = []
    for profile, settings, recording in profiles(fitter.device.actuator.voltage_range[1]):
        answers = parallel(lambda d, r=recording: simulate_channels(d, r), devices)
        for extra in (None, *(c for c in CHANNELS if c not in have)):
            channels = have if extra is None else (*have, extra)
            closest = min(_distance(a, b, channels, noise)
                          for a, b in itertools.combinations(answers, 2))
            # A channel more is more work than another profile: ask for it when it pays.
            cost = 1.0 if extra is None else 1.5
            candidates.append((closest / cost, closest, profile, settings, extra))
    candidates.sort(key=lambda c: -c[0])
    _, separation, profile, settings, extra = candidates[0]
    others = [c[1:] for c in candidates[1:] if c[2] != profile or c[4] != extra][:2]
    among = 'the tied causes' if len(tied) == len(names) else (
        f'the first {len(names)} of {len(tied)} tied causes, no others compared,')

    def entry(separation, profile, settings, extra):
        besides = f', {extra} measured besides' if extra else ''
        return _entry(separation, profile, settings, extra, told, (
            f'the two closest of {among} then differ by {separation:.1f} times the noise'
            f'{besides}'))

    return {**entry(separation, profile, settings, extra),
            'alternatives': [entry(*other) for other in others]}


def first_experiment(fitter: Fitter, evidence: Evidence, phi: np.ndarray) -> dict:
    """
    Return the ``next_experiment`` part of a diagnosis of a device that was asked nothing.

    The profile in which the most effects of a typical strength stand out of the noise, with the
    channels at hand.

    Parameters
    ----------
    fitter : Fitter
        Of the set.
    evidence : Evidence
        What was measured, for its channels and noise.
    phi : ndarray, shape (p,)
        Deviations of the nominal parameters.

    """
    devices = [fitter.device_with({}, phi), *(
        fitter.device_with({name: effect.typical()}, phi) for name, effect in EFFECTS.items())]
    noise, candidates = _noise(evidence), []
    for profile, settings, recording in profiles(fitter.device.actuator.voltage_range[1]):
        usual, *others = parallel(lambda d, r=recording: simulate_channels(d, r), devices)
        apart = sorted(_distance(usual, other, evidence.channels, noise) for other in others)
        candidates.append((sum(each > SEEN for each in apart), apart[len(apart) // 2], profile,
                           settings))

    def entry(seen, middle, profile, settings):
        return _entry(middle, profile, settings, None, [], (
            f'{seen} of the {len(EFFECTS)} effects in the library, each of a typical strength, '
            f'would then stand out of the noise, half of them by {significant(middle)} times or '
            'more'))

    best, *others = sorted(candidates, key=lambda c: c[:2], reverse=True)
    return {**entry(*best),
            'alternatives': [entry(*other) for other in others if other[2] != best[2]][:2]}


def _noise(evidence: Evidence) -> dict[str, float]:
    """Return the noise of every channel (SI, rms): as measured, or as is usual."""
    return {c: evidence.noise_rms(c) if c in evidence.noise else USUAL_NOISE[c]
            for c in CHANNELS}


def _entry(separation, profile, settings, extra, told, why) -> dict:
    words = ' '.join(
        f'--{key} ' + ' '.join(f'{each:g}' for each in (
            value if isinstance(value, list) else [value]))
        for key, value in settings.items())
    return {'profile': profile, 'settings': settings, 'add_channel': extra, 'separates': told,
            'separation': float(separation),
            'command': f'piezo_stack excite {profile} {words} --out next_{profile}',
            'why': why}


def _distance(a: dict, b: dict, channels, noise) -> float:
    worst = 0.0
    for channel in channels:
        difference = a[channel] - b[channel]
        rows = difference.size // AVERAGE * AVERAGE
        slow = difference[:rows].reshape(-1, AVERAGE).mean(axis=1)
        worst = max(worst, float(np.sqrt(np.mean(slow ** 2))) / noise[channel]
                    * AVERAGE ** 0.5)
    return worst
