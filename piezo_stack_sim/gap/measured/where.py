# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Where the gap is: the model cut at its ports, then records, bands and regimes.

Each block is driven by what was *measured* before it.  The drive is compared by
its voltage; the electrical block gets the measured voltage if that differs from
the simulated one, and the measured displacement, which takes charge, too; what
follows gets the measured charge, through the linear second-order path from charge
to displacement (Eqs. 11, 14 and 15 of the paper).  So one block's error does not
leak into the next.  A sensor that reads wrong leaks into what it drives: where the
displacement is wrong by itself, the electrical block with the displacement as
measured or as simulated counts, whichever is quieter.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
import math

import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.measured.apart import gain_per_charge, moved_by_charge, noise_moved
from piezo_stack_sim.gap.measured.evidence import Evidence, Track
from piezo_stack_sim.gap.measured.forward import simulate_channels, spans
from piezo_stack_sim.gap.measured.noise import integrated_correlation
from piezo_stack_sim.gap.measured.voltage import above_noise, MeasuredVoltage
from piezo_stack_sim.plant import Device
from piezo_stack_sim.recording.recording import Recording

BEHIND_CHARGE = ('transducer', 'mechanical', 'environment', 'sensor')
BANDS = (0.0, 1.0, 10.0, 100.0, 1000.0, math.inf)
# Cuts, and how they are named: a charge drive ends at the charge.
CUTS = {'drive': 'drive', 'charged': 'drive', 'electrical': 'electrical', 'across': 'electrical',
        'behind': 'behind'}
ITSELF = 0.1  # power of what is wrong behind the charge, against that before it, that is some
UNCOUPLED = 1e-9  # of the ratio of a stack whose displacement takes no charge
LOUD = 1.15  # rms over noise from which a block counts as wrong
CLEARLY = 2.0  # and from which nobody doubts it


def block_residuals(device: Device, evidence: Evidence, simulated, behind: Device | None = None
                    ) -> list[dict]:
    """
    Return for each track the residual of each cut, all as displacement.

    Parameters
    ----------
    device : Device
        Re-tuned to all recordings.
    evidence : Evidence
        Of the recordings.
    simulated : sequence of dict
        Channel to (n,) array for each track, from the device.
    behind : Device, optional
        What lies behind the terminals, if that was tuned by itself.

    Returns
    -------
    list of dict
        ``drive`` (or ``charged``, of a charge drive), ``electrical`` and ``behind`` where the
        channels allow, each a pair of the residual (m, averaged rows) and the rms of its
        noise (m); ``across``, the voltage against the charge, where that is driven or held;
        beside them ``through``, the displacement against the voltage, charge passed over, and
        ``given``, the charge against the voltage and the measured displacement.

    """
    gain = gain_per_charge(device)
    per_volt = _gain_per_volt(evidence, simulated)

    def one(i):
        track, recording = evidence.tracks[i], evidence.tracks[i].recording
        out, answer = {}, simulated[i]
        has = track.measured.__contains__
        if recording.drive == 'voltage' and has('voltage'):
            wrong = track.unbiased('voltage', track.misfit('voltage', answer['voltage']))
            noise = track.sigma['voltage']
            out['drive'] = (wrong * per_volt, noise * per_volt)
            if behind is not None or np.sqrt(np.mean(wrong ** 2)) > LOUD * noise:
                # The electrical block is to be driven by what really was at its terminals.
                ideal = without_driver(behind or device)
                answer = MeasuredVoltage.of(track, device).answer_of(ideal)
        if has('charge'):
            wrong = track.unbiased('charge', track.misfit('charge', answer['charge']))
            # With the leads open or shorted there is no drive that could be wrong.
            out['charged' if recording.drive == 'charge' else 'electrical'] = (
                wrong * gain, track.sigma['charge'] * gain)
        if has('displacement'):
            wrong = recording.measured['displacement'] - answer['displacement']
            noise = track.sigma['displacement']
            if has('charge'):
                if recording.drive == 'voltage':
                    out['through'] = (track.unbiased(
                        'displacement', track.average(wrong, 'displacement')), noise)
                    out['given'] = _given(track, behind or device, answer, gain)
                given = recording.measured['charge'] - answer['charge']
                wrong = wrong - moved_by_charge(device, given, recording.period)
                noise = math.hypot(noise, track.sigma['charge'] * noise_moved(
                    device, recording.period, track.factor))
            out['behind'] = (track.unbiased(
                'displacement', track.average(wrong, 'displacement')), noise)
        if recording.drive in ('charge', 'open') and has('voltage'):
            out['across'] = _across(track, behind or device, answer, per_volt)
        return out

    return parallel(one, range(len(evidence.tracks)))


def without_driver(device: Device) -> Device:
    """Return a device without what is known of its driver."""
    return device.replace(effects={name: values for name, values in device.effects.items()
                                   if EFFECTS[name].block != 'drive'})


def _given(track: Track, device: Device, answer: dict, gain: float) -> tuple[np.ndarray, float]:
    """
    Return what is wrong with the charge if the stack moved as was measured, as displacement (m).

    A stack that cannot move takes the charge of one that does, at a voltage that is higher by what
    the displacement induces: q = T x + C (v - v_rc) (Eqs. 11 and 12 of the paper).
    """
    recording, actuator = track.recording, device.actuator
    change = np.zeros(len(recording))
    moved = recording.measured['displacement'] - answer['displacement']
    noise = track.zero['displacement']
    if np.sqrt(np.mean(track.unbiased('displacement', track.average(moved)) ** 2)) > (
            LOUD * track.sigma['displacement']):
        clamped = device.replace(effects={}, actuator=actuator.replace(
            transformer_ratio=UNCOUPLED * actuator.transformer_ratio))
        induced = actuator.transformer_ratio / actuator.linear_capacitance
        moved = answer['displacement'] + above_noise(moved, noise)
        taken = [_charge(clamped, recording, answer['voltage'] + induced * displacement)
                 for displacement in (moved, answer['displacement'])]
        change = taken[0] - taken[1]
    wrong = track.unbiased('charge', track.misfit('charge', answer['charge'] + change))
    return wrong * gain, track.sigma['charge'] * gain


def _charge(device: Device, recording: Recording, voltage: np.ndarray) -> np.ndarray:
    """Return the charge (C) that a voltage (V) at the rows brings, (n,)."""
    # What is there at a row was commanded in the one before it.
    command = np.append(voltage[1:], voltage[-1])
    return simulate_channels(device, Recording(
        recording.name, recording.time, 'voltage', command))['charge']


def _across(track: Track, device: Device, answer: dict, per_volt: float
            ) -> tuple[np.ndarray, float]:
    """
    Return what is wrong with the voltage over a charge that is driven or held, as displacement.

    Driven by the measured charge and displacement where these are wrong.
    """
    recording, has = track.recording, track.measured.__contains__
    expected = answer['voltage']

    def wrong_by(channel):
        return above_noise(recording.measured[channel] - answer[channel], track.zero[channel])

    if recording.drive == 'charge' and has('charge'):
        missed = wrong_by('charge')
        if missed.any():
            ideal = device.replace(effects={})
            command = recording.command + np.append(missed[1:], missed[-1])
            expected = expected + (
                simulate_channels(ideal, recording.replace(command=command))['voltage']
                - simulate_channels(ideal, recording)['voltage'])
    if has('displacement'):
        actuator = device.actuator
        expected = expected - wrong_by('displacement') * (
            actuator.transformer_ratio / actuator.linear_capacitance)
    wrong = track.unbiased('voltage', track.misfit('voltage', expected))
    return wrong * per_volt, track.sigma['voltage'] * per_volt


def _gain_per_volt(evidence, simulated) -> float:
    """Return the large-signal displacement per volt (m/V) in these recordings."""
    best = 1.3e-7
    widest = 0.0
    for track, answer in zip(evidence.tracks, simulated):
        span = float(np.ptp(answer['voltage']))
        if span > widest:
            widest, best = span, float(np.ptp(answer['displacement'])) / span
    return best


def last_cut(causes: Sequence[str], suspect: str, channels: Collection[str]) -> str | None:
    """
    Return the block to name the last cut after: all that lies behind the last measured port.

    Parameters
    ----------
    causes : sequence of str
        Effects that were selected.
    suspect : str
        The best effect, selected or not; it tells no more than what follows the charge.
    channels : collection of str
        Measured channels.

    """
    spanned = spanned_last(channels)
    blocks = [b for b in (EFFECTS[name].block for name in causes) if b in spanned]
    blocks += [b for b in (EFFECTS[suspect].block,) if b in BEHIND_CHARGE]
    return blocks[0] if blocks else None


def spanned_last(channels: Collection[str]) -> tuple[str, ...]:
    """Return the blocks that the last cut spans: those behind the last measured port."""
    if 'charge' in channels:
        return BEHIND_CHARGE
    if 'voltage' in channels:
        return ('electrical', *BEHIND_CHARGE)
    return ('drive', 'electrical', *BEHIND_CHARGE)


def shares(cuts: list[dict], last: str | None, channels: Collection[str]) -> tuple[dict, dict]:
    """
    Return each block's fraction of the gap's power, and its gap over the noise.

    ``last`` is the block that the last cut is named after, ``channels`` are the
    measured ones.  ``spans`` tells what a cut holds beside the block that it is named after.
    """
    cuts = _quieter(cuts)
    begins = {'drive': 'command', 'charged': 'command',
              'electrical': 'voltage' if 'voltage' in channels else 'command',
              'across': 'charge' if 'charge' in channels else 'command',
              'behind': next((port for port in ('charge', 'voltage') if port in channels),
                             'command')}
    ends = {'drive': 'voltage', 'charged': 'charge', 'electrical': 'charge', 'across': 'voltage',
            'behind': 'displacement'}
    named = {**CUTS, 'behind': last or 'mechanical'}
    spanned = {'behind': spanned_last(channels),
               'electrical': () if 'voltage' in channels else ('drive', 'electrical')}
    ports: dict[str, tuple[str, str]] = {}
    held: dict[str, tuple[str, ...]] = {}
    power: dict[str, float] = {}
    for cut in cuts:
        for name in (name for name in CUTS if name in cut):
            wrong, noise = cut[name]
            block = named[name]
            ports[block] = begins[name], ends[name]
            held[block] = spanned.get(name, ())
            square = float(np.mean(wrong ** 2))
            power[block] = power.get(block, 0.0) + max(square - (LOUD * noise) ** 2, 0.0)
    fractions = _fractions(power)
    blocks = {}
    for block, (ratio, independent) in _over_noise(cuts, named).items():
        half = 1.96 * ratio / math.sqrt(2.0 * max(independent, 2.0))
        blocks[block] = {'over_noise': ratio, 'ci': [max(ratio - half, 0.0), ratio + half],
                         'from': [ports[block][0]], 'to': ports[block][1],
                         **({'spans': list(held[block])} if held[block] else {})}
    return fractions, blocks


def is_driver_loudest(cuts: Sequence[dict]) -> bool:
    """
    Tell whether the voltage at the terminals is what is most wrong, in multiples of the noise.

    All else is driven by the measured voltage: what is wrong with it is the driver's, whatever
    that does to what follows.
    """
    ratios = {name: ratio for name, (ratio, _) in _over_noise(cuts, CUTS).items()}
    return ratios.get('drive', 0.0) > CLEARLY and max(ratios, key=ratios.__getitem__) == 'drive'


def _quieter(cuts: Sequence[dict]) -> list[dict]:
    """Return cuts with the displacement that leaves least of the electrical, as a whole."""
    def excess(name):
        return sum(max(float(np.mean(wrong ** 2)) - (LOUD * noise) ** 2, 0.0)
                   for wrong, noise in (cut[name] for cut in cuts if 'given' in cut))

    before = excess('electrical')
    if excess('behind') > ITSELF * before and excess('given') < before:
        cuts = [{**cut, 'electrical': cut['given']} if 'given' in cut else cut for cut in cuts]
    return list(cuts)


def _over_noise(cuts: Sequence[dict], named: Mapping[str, str]
                ) -> dict[str, tuple[float, float]]:
    """
    Return the gap of every cut over its noise, rms over the recordings, and independent rows.

    By what each is ``named``: a cut may be named like another.
    """
    loud: dict[str, list[float]] = {}
    rows: dict[str, float] = {}
    for cut in cuts:
        for name in (name for name in CUTS if name in cut):
            wrong, noise = cut[name]
            square = float(np.mean(wrong ** 2))
            loud.setdefault(named[name], []).append(square / max(noise, 1e-30) ** 2)
            rows[named[name]] = rows.get(named[name], 0.0) + (
                wrong.size / integrated_correlation(wrong))
    return {name: (math.sqrt(np.mean(squares)), rows[name]) for name, squares in loud.items()}


def by_record(evidence: Evidence, residual: np.ndarray) -> tuple[dict, dict]:
    """Return the fraction of the gap's power by recording and by channel."""
    records, channels = {}, {}
    for (i, channel), where in zip(evidence.keys, spans(evidence)):
        excess = max(float(np.sum(residual[where] ** 2 - 1.0)), 0.0)
        name = evidence.tracks[i].recording.name
        records[name] = records.get(name, 0.0) + excess
        channels[channel] = channels.get(channel, 0.0) + excess
    return _fractions(records), _fractions(channels)


def _fractions(power: dict) -> dict:
    total = sum(power.values())
    return {name: (float(value / total) if total > 0.0 else 0.0)
            for name, value in power.items()}


def by_band(evidence: Evidence, residual: np.ndarray) -> list[dict]:
    """Return the fraction of the gap's power by frequency band (Hz), of those that were seen."""
    power, highest = np.zeros(len(BANDS) - 1), 0.0
    for (i, _), where in zip(evidence.keys, spans(evidence)):
        track = evidence.tracks[i]
        series = residual[where]
        spectrum = np.abs(np.fft.rfft(series)) ** 2 / series.size
        spectrum[1:] *= 2.0
        frequency = np.fft.rfftfreq(series.size, track.recording.period * track.factor)
        band = np.digitize(frequency, BANDS) - 1
        highest = max(highest, float(frequency[-1]))
        for b in range(power.size):
            inside = band == b
            # White noise of unit variance puts 1 (DC) or 2 into every line.
            power[b] += max(float(np.sum(spectrum[inside]) - 2.0 * inside.sum()), 0.0)
    total = power.sum()
    return [{'low': low, 'high': None if math.isinf(high) else high,
             'share': float(value / total) if total > 0.0 else 0.0}
            for low, high, value in zip(BANDS, BANDS[1:], power) if low <= highest]


def by_regime(evidence: Evidence, residual: np.ndarray) -> list[dict]:
    """Return in which regimes of the motion the gap sits."""
    power: dict[str, float] = {}
    rows: dict[str, int] = {}
    total = size = 0.0
    for (i, _), where in zip(evidence.keys, spans(evidence)):
        track = evidence.tracks[i]
        excess = residual[where] ** 2 - 1.0
        # What is as quiet as its noise has no gap of which a part could lie anywhere.
        loud = float(excess.sum()) > 0.0
        total += loud * float(excess.sum())
        size += loud * excess.size
        for name, inside in _regimes(track).items():
            power[name] = power.get(name, 0.0) + loud * float(excess[inside].sum())
            rows[name] = rows.get(name, 0) + int(inside.sum()) * loud
    mean = total / max(size, 1.0)
    return [{'name': name, 'share': min(max(of_it / total, 0.0), 1.0) if total else 0.0,
             'ratio': max(of_it / max(rows[name], 1) / mean, 0.0) if total else 0.0}
            for name, of_it in power.items()]


def _regimes(track) -> dict[str, np.ndarray]:
    """
    Return which rows of a track rise, fall, hold, or lie at high bias, shape (m,) each.

    Of a command that never moves none does any of it.
    """
    force = track.average(track.recording.external_force)
    pushed = {'external force': np.abs(force) > 1e-3 * (np.abs(force).max() or 1.0)}
    if not np.ptp(track.recording.command):
        return pushed
    command = track.average(track.recording.command)
    rate = np.gradient(command)
    scale = np.abs(rate).max() or 1.0
    still = np.abs(rate) < 1e-3 * scale
    span = np.ptp(command) or 1.0
    level = (command - command.min()) / span
    near = np.zeros(command.size, dtype=bool)
    turn = np.flatnonzero(np.diff(np.sign(np.where(still, 0.0, rate))) != 0)
    width = max(2, command.size // 400)
    for t in turn[:2000]:
        near[max(0, t - width):t + width] = True
    last = np.maximum.accumulate(np.where(~still, np.arange(command.size), 0))
    since = (np.arange(command.size) - last) * track.recording.period * track.factor
    return {
        'rising': (rate > 0) & ~still, 'falling': (rate < 0) & ~still,
        'near reversals': near, 'high bias': level > 2.0 / 3.0, 'low bias': level < 1.0 / 3.0,
        'holding, up to 1 s after a change': still & (since < 1.0),
        'holding, more than 1 s after a change': still & (since >= 1.0),
        **pushed,
    }
