# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parts of ``diagnosis.json`` that are numbers about fits and channels."""

from __future__ import annotations

import math

import numpy as np

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.deciding.ranked import Ranked
from piezo_stack_sim.gap.deciding.score import channel_power, Judge, noise_power, without_zero
from piezo_stack_sim.gap.fitting.fit import Fit, Fitter, Free
from piezo_stack_sim.gap.measured.evidence import Evidence, STRETCHES
from piezo_stack_sim.gap.measured.filled import series
from piezo_stack_sim.gap.measured.forward import spans
from piezo_stack_sim.gap.measured.noise import integrated_correlation
from piezo_stack_sim.gap.quantities import percent, significant, words
from piezo_stack_sim.gap.report.wording import times_worse

UNITS = {'mass': 'kg', 'stiffness': 'N/m', 'damping': 'N s/m', 'linear_capacitance': 'F',
         'transformer_ratio': 'N/V'}
# Of the standard error of S: part of what stays, and the least. Learned on 180 devices, whose
# true S lay in 66 % of the intervals without them.
STAYS, LEAST = 0.3, 5e-4
LEAST_GAP = 0.05  # of the power of the noise, from which there is a gap
ZERO = 3.0  # standard deviations of a row by which the zero of a sensor may be off


def gap_part(evidence: Evidence, simulated: list[dict]) -> dict:
    """Return the gap of every channel, all rows, against one simulation."""
    result = {}
    for channel in evidence.channels:
        wrong, span, independent = [], 0.0, 0.0
        for track, answer in zip(evidence.tracks, simulated):
            if channel not in track.measured:
                continue
            measured = track.recording.measured[channel]
            error, _ = series(track.recording, channel, answer[channel])
            if channel != 'voltage' and abs(error.mean()) < ZERO * track.zero[channel]:
                error = error - error.mean()  # the zero was read off a single row
            wrong.append(error)
            span = max(span, float(np.ptp(measured)))
            independent += error.size / integrated_correlation(error)
        rms = float(np.sqrt(np.mean(np.concatenate(wrong) ** 2)))
        noise = evidence.noise_rms(channel)
        ratio = rms / noise
        half = 1.96 * ratio / math.sqrt(2.0 * max(independent, 2.0))
        result[channel] = {
            'rms': rms, 'nrmse': rms / span if span > 0.0 else None, 'noise_rms': noise,
            'over_noise': ratio, 'ci': [max(ratio - half, 0.0), ratio + half]}
    return result


def records_part(evidence: Evidence) -> list[dict]:
    """Return what was read, one row a recording."""
    return [{
        'name': track.recording.name, 'source': track.recording.source,
        'drive': track.recording.drive, 'rows': len(track.recording),
        'duration': track.recording.duration, 'rate': float(track.recording.rate),
        'channels': list(track.channels), 'has_force': track.recording.has_force,
        'role': 'both'} for track in evidence.tracks]


def standard_errors(fitter: Fitter, fit: Fit) -> np.ndarray:
    """
    Return the standard errors of (walk, phi) of a fit.

    Residuals are correlated in time: their power counts by the number of
    independent rows, not of rows.
    """
    n = len(fit.free)
    if fit.slope is None or fit.nominal is None:
        return np.full(n + fitter.nuisance.prior.size, np.inf)
    jacobian = np.column_stack([fit.slope[fitter.rows], fit.nominal[fitter.rows]])
    weights = np.empty(fit.residual.size)
    for (_, _), where in zip(fitter.evidence.keys, spans(fitter.evidence)):
        tau = integrated_correlation(fit.residual[where])
        weights[where] = 1.0 / (tau * max(float(np.mean(fit.residual[where] ** 2)), 1.0))
    weights = weights[fitter.rows]
    precision = np.concatenate([np.full(n, 1e-12), fitter.nuisance.prior ** -2.0])
    square = (jacobian * weights[:, None]).T @ jacobian + np.diag(precision)
    return np.sqrt(np.maximum(np.diag(np.linalg.pinv(square)), 0.0))


def calibration_part(fitter: Fitter, fit: Fit, chosen: Fit | None = None) -> dict:
    """
    Return the re-tuned nominal parameters of Table 1, and the scale if it was free.

    With those that a ``chosen`` correction has, which were tuned again beside its effects.
    """
    nuisance = fitter.nuisance
    errors = standard_errors(fitter, fit)[len(fit.free):]
    shown = {name: i for i, name in enumerate(nuisance.names[:5])}
    nominal = {name: getattr(fitter.device.actuator, name) for name in shown}
    if nuisance.scale_free:
        shown['displacement_scale'], nominal['displacement_scale'] = len(fit.phi) - 1, 1.0
    result = {name: _tuned(nominal[name], float(fit.phi[i]), float(errors[i]),
                           float(nuisance.bound[i])) | {'unit': UNITS.get(name, '1')}
              for name, i in shown.items()}
    if chosen is not None:
        for name, i in shown.items():
            # A gain of the sensor that is a cause takes the place of the scale.
            if name in UNITS or 'sensor_gain' not in chosen.effects:
                result[name]['corrected'] = nominal[name] * (1.0 + float(chosen.phi[i]))
    return result


def _tuned(nominal: float, phi: float, error: float, bound: float) -> dict:
    """Return a number that was re-tuned by phi, its interval as far as that is allowed."""
    half, phi = 1.96 * error, min(max(phi, -bound), bound)  # a bound holds but for rounding
    side = int(phi > 0.999 * bound) - int(phi < -0.999 * bound)
    return {'nominal': nominal, 'fitted': nominal * (1.0 + phi),
            'ci': [nominal * (1.0 + end)
                   for end in (max(phi - half, -bound), min(phi + half, bound))],
            'allowed': bound, 'at_bound': {0: False, 1: 'upper', -1: 'lower'}[side]}


def cause_part(ranked: Ranked, fit: Fit, probability: float, judge: Judge, nominal: Fit,
               fitter: Fitter, earlier: Fit | None = None) -> dict:
    """
    Return one row of ``causes``.

    What ``fit`` kept of an ``earlier`` one is as sure as it was there.
    """
    names = ranked.name.split('+')
    blocks = list(dict.fromkeys(EFFECTS[name].block for name in names))
    gain, error = judge.difference(fit.residual, nominal.residual)
    sources = [(each, standard_errors(fitter, each) if probability > 0.01 and each.free else None)
               for each in _sources(fit, earlier)]
    parameters = {}
    for name in names:
        source, errors = next((row for row in sources if _is_free(row[0], name)), sources[0])
        awake = any(free.parameter.late for free in source.free if free.effect == name)
        for parameter in EFFECTS[name].parameters:
            value = fit.effects[name][parameter.name]
            if (parameter.late or awake) and value == parameter.neutral:
                continue  # what only mends the form and was not asked for that, or counts no more
            key = parameter.name if len(names) == 1 else f'{name}.{parameter.name}'
            parameters[key] = _parameter(parameter, value, source, name, errors)
    return {'effect': ranked.name, 'block': '+'.join(blocks),
            'summary': ' '.join(EFFECTS[name].summary for name in names),
            'probability': min(max(probability, 0.0), 1.0), 'parameters': parameters,
            'delta_log_score': float(gain), 'se': float(error), 'S': float(ranked.removed)}


def _is_free(fit: Fit, effect: str) -> bool:
    return any(free.effect == effect for free in fit.free)


def _sources(fit: Fit, earlier: Fit | None) -> list[Fit]:
    """Return a fit, and an earlier one if that was free in an effect that is kept from it."""
    if earlier is None or earlier is fit:
        return [fit]
    kept = [name for name, values in fit.effects.items()
            if not _is_free(fit, name) and earlier.effects.get(name) == values]
    return [fit, earlier] if any(_is_free(earlier, name) for name in kept) else [fit]


def stuck_of(fit: Fit, earlier: Fit | None = None) -> list[Free]:
    """Return what came to rest at its bound, also in an earlier fit from which it was kept."""
    return [free for i, each in enumerate(_sources(fit, earlier)) for free in each.stuck
            if i == 0 or not _is_free(fit, free.effect)]


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _parameter(parameter, value, fit: Fit, effect: str, errors) -> dict:
    ci = None
    at_bound: bool | str = False
    for j, free in enumerate(fit.free):
        if free.effect == effect and free.parameter.name == parameter.name:
            at_bound = free.stuck(value) or False
            if errors is not None and errors[j] < 50.0:
                place = free.to_walk(max(value, parameter.lower))
                ends = [free.to_value(place - 1.96 * errors[j]),
                        free.to_value(place + 1.96 * errors[j])]
                # No device has what lies beyond the bounds, a resistance below zero, say.
                ci = [_finite(min(max(end, parameter.lower), parameter.upper)) for end in ends]
    return {'value': _finite(value), 'unit': parameter.unit, 'ci': ci, 'at_bound': at_bound,
            'neutral': _finite(parameter.neutral), 'lower': _finite(parameter.lower),
            'upper': _finite(parameter.upper), 'typical': _finite(parameter.typical)}


def shrinkage_part(evidence: Evidence, base, after, flexible, placebos, others=()) -> dict:
    """
    Return S of every channel on the withheld rows, with placebo and ceiling.

    No effect of the library, ``others`` being what each leaves, explains more than the ceiling.
    """
    noise = noise_power(evidence)
    old, new = (channel_power(evidence, residual, centred=True) for residual in (base, after))
    least = [channel_power(evidence, residual, centred=True)
             for residual in (flexible, after, *others)]
    false = {channel: float(np.median([channel_power(evidence, placebo, centred=True)[channel]
                                       for placebo in placebos])) for channel in noise}
    result: dict = {'placebo': {}, 'ceiling': {}}
    for channel, level in noise.items():
        gap = old[channel] - level
        span = max(float(np.ptp(t.measured[channel])) for t in evidence.tracks
                   if channel in t.measured)
        entry: dict = {'before': old[channel], 'after': new[channel], 'noise': level,
                       'S': None, 'ci': None, 'span': span}
        share = 1.0 - (new[channel] - level) / gap if gap > LEAST_GAP * level else math.nan
        ci = _interval(evidence, base, after, channel, level, share)
        real = ci is not None
        if real:
            entry.update(S=share, ci=ci)
        result[channel] = entry
        result['placebo'][channel] = 1.0 - (false[channel] - level) / gap if real else None
        lowest = min(power[channel] for power in least)
        result['ceiling'][channel] = 1.0 - (lowest - level) / gap if real else None
    result['withheld'] = [f'every second of {STRETCHES} stretches of {t.recording.name}'
                          for t in evidence.tracks]
    return result


def outdone(shrinkage: dict) -> list[str]:
    """Return warnings of channels in which a placebo removes more than what was switched on."""
    return [f'a correction that exists in no device removes more of the gap in {words(channel)} '
            f'({percent(false)}) than what is switched on ({percent(shrinkage[channel]["S"])}): '
            'distrust it'
            for channel, false in shrinkage['placebo'].items()
            if false is not None and false > max(shrinkage[channel]['S'], 0.0)]


def worsened(shrinkage: dict) -> list[str]:
    """Return warnings of channels in which what was switched on leaves more than was wrong."""
    times = {channel: times_worse(row) for channel, row in shrinkage.items() if 'after' in row}
    return [f'what is switched on makes the {words(channel)} {significant(worse, 2)} times as '
            'wrong as it was: of that channel it explains nothing'
            for channel, worse in times.items() if worse is not None]


def _interval(evidence: Evidence, base, after, channel, level, share: float
              ) -> list[float] | None:
    """
    Return the 95 % interval of S, ``share``: the withheld stretches bootstrapped, then widened.

    None where the gap itself may be chance: a part of it says nothing.

    Stretches of one set share what they have wrong: what stays could as well be more or less by
    a learned part of it.
    """
    if math.isnan(share):
        return None
    random = np.random.default_rng(7)
    old, new, size = [], [], []
    for (i, c), where in zip(evidence.keys, spans(evidence)):
        if c != channel:
            continue
        track = evidence.tracks[i]
        stretch = np.arange(track.fitted.size) * STRETCHES // track.fitted.size
        for s in range(1, STRETCHES, 2):
            inside = stretch == s
            for sums, errors in ((old, base), (new, after)):
                error = without_zero(track, c, errors[where])
                sums.append(float(np.sum(error[inside] ** 2)))
            size.append(int(inside.sum()))
    old_, new_, size_ = np.array(old), np.array(new), np.array(size)
    pick = random.integers(0, old_.size, (400, old_.size))
    rows = size_[pick].sum(axis=1)
    before, then = old_[pick].sum(axis=1) / rows, new_[pick].sum(axis=1) / rows
    if np.quantile(before, 0.025) <= level:
        return None
    values = 1.0 - (then - level) / np.maximum(before - level, 1e-3 * level)
    low, high = np.quantile(values, [0.025, 0.975])
    half = 1.96 * math.hypot(0.5 * (high - low) / 1.96, STAYS * (1.0 - share), LEAST)
    return [float(min(low, share - half)), float(max(high, min(1.0, share + half)))]
