# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Diagnoses made up from simple formulas, one for each verdict, for tests of what shows them.

No plant is involved: a few play operators stand for the stack, a sum of relaxations for the creep
that "the real device" has and "the simulation" lacks.
"""

from functools import lru_cache
import json

import numpy as np
from piezo_stack_sim.gap.schema import SCHEMA_ID
from piezo_stack_sim.gap.traces import build_traces
from piezo_stack_sim.recording.recording import Recording

NOISE = {'displacement': 2e-9, 'charge': 5e-9, 'voltage': 5e-3}
GAIN = 0.115e-6  # m/V
CHARGE = 1.07e1  # C/m
CREEP = 0.006

CANDIDATES = (
    ('creep', 'electrical', 'Slow polarisation: charge and displacement go on after a step.',
     {'gain_per_decade': (0.0148, '', 0.0, 0.0, 0.05), 'onset': (0.11, 's', 0.1, 1e-3, 10.0)}),
    ('mount_creep', 'mechanical', 'The glue under the stack yields slowly.',
     {'gain': (0.031, '', 0.0, 0.0, 0.2), 'time_constant': (4.2, 's', 1.0, 1e-2, 1e3)}),
    ('thermal_drift', 'environment', 'The frame expands as the laboratory warms.',
     {'rate': (3.1e-10, 'm/s', 0.0, -1e-8, 1e-8)}),
    ('sensor_drift', 'sensor', 'The zero of the displacement sensor wanders.',
     {'rate': (2.9e-10, 'm/s', 0.0, -1e-8, 1e-8)}),
    ('rate_dependent_hysteresis', 'electrical', 'The loop widens with frequency.',
     {'gain_per_decade': (0.004, '', 0.0, 0.0, 0.1)}),
    ('leakage', 'electrical', 'Charge trickles through the insulation.',
     {'resistance': (1e10, 'ohm', None, 1e5, 1e10)}),
    ('amplifier_bandwidth', 'drive', 'The amplifier follows with a lag.',
     {'frequency': (9.8e3, 'Hz', None, 10.0, 1e4)}),
    ('sensor_lag', 'sensor', 'The displacement sensor follows with a lag.',
     {'time_constant': (2.2e-6, 's', 0.0, 0.0, 1e-2)}),
    ('friction', 'mechanical', 'The guide rubs.',
     {'force': (0.08, 'N', 0.0, 0.0, 50.0), 'stiffness': (2.1e6, 'N/m', 1e6, 1e4, 1e8)}),
    ('added_mass', 'mechanical', 'The stack moves more than itself.',
     {'mass': (0.0, 'kg', 0.0, 0.0, 1.0)}),
)
PROBABILITY = {
    'NO_GAP': (0.03, 0.02, 0.02, 0.02, 0.01),
    'CAUSE': (0.962, 0.021, 0.008, 0.004, 0.003, 0.001),
    'MULTIPLE': (0.94, 0.03, 0.01, 0.01, 0.004, 0.003),
    'AMBIGUOUS': (0.43, 0.31, 0.22, 0.02, 0.01),
    'UNKNOWN': (0.09, 0.07, 0.03, 0.02),
    'NOT_IDENTIFIABLE': (0.21, 0.19, 0.17, 0.16, 0.12, 0.1),
}
SELECTED = {
    'NO_GAP': [], 'CAUSE': ['creep'], 'MULTIPLE': ['creep', 'amplifier_bandwidth'],
    'AMBIGUOUS': ['creep'], 'UNKNOWN': [], 'NOT_IDENTIFIABLE': [],
}
TIED = {'AMBIGUOUS': ['creep', 'mount_creep', 'thermal_drift'],
        'NOT_IDENTIFIABLE': ['creep', 'mount_creep', 'thermal_drift', 'sensor_drift', 'leakage']}


@lru_cache(maxsize=None)
def make_recordings(seed=1, creep=CREEP, channels=('voltage', 'charge', 'displacement')):
    """Return the recordings, and the channels simulated without and with creep."""
    random = np.random.default_rng(seed)
    recordings, before, after = [], [], []
    for name, (time, voltage, force) in _programmes(random).items():
        ideal = GAIN * _loop(voltage) + force / 52e6
        real = ideal + creep * _relaxations(time, ideal)
        simulated = {'displacement': ideal, 'charge': CHARGE * ideal, 'voltage': voltage}
        mended = {**simulated, 'displacement': ideal + 0.86 * (real - ideal),
                  'charge': CHARGE * (ideal + 0.86 * (real - ideal))}
        measured = {'voltage': voltage, 'charge': CHARGE * real, 'displacement': real}
        measured = {channel: measured[channel] + NOISE[channel] * random.standard_normal(len(time))
                    for channel in channels}
        recordings.append(Recording(name, time, 'voltage', voltage,
                                    force if name == 'force' else None,
                                    measured=measured, source=f'bench/{name}.csv'))
        before.append(simulated)
        after.append(mended)
    return recordings, before, after


def make_diagnosis(verdict='CAUSE'):
    """Return a valid diagnosis with that verdict; it is the caller's to change."""
    return json.loads(_diagnosis_text(verdict))


@lru_cache(maxsize=None)
def _diagnosis_text(verdict):
    return json.dumps(_diagnosis(verdict))


def _diagnosis(verdict):
    creep = {'NO_GAP': 1e-6, 'MULTIPLE': 1.6 * CREEP}.get(verdict, CREEP)
    recordings, before, after = make_recordings(creep=creep)
    selected, tied = SELECTED[verdict], TIED.get(verdict, [])
    traces = build_traces(recordings, before, after if selected else None, NOISE)
    gap = {channel: _gap(recordings, before, channel) for channel in NOISE}
    left = {channel: _gap(recordings, after if selected else before, channel) for channel in NOISE}
    shares = {'electrical': 0.83, 'drive': 0.02, 'transducer': 0.03, 'mechanical': 0.08,
              'sensor': 0.03, 'environment': 0.01}
    if verdict == 'UNKNOWN':
        shares.update(electrical=0.14, mechanical=0.77)
    found = verdict not in ('NO_GAP', 'NOT_IDENTIFIABLE')
    return {
        'schema': SCHEMA_ID,
        'verdict': verdict,
        'confidence': {'NO_GAP': 0.99, 'UNKNOWN': 0.91, 'CAUSE': 0.962, 'MULTIPLE': 0.94,
                       'AMBIGUOUS': 0.96}.get(verdict),
        'reason': _REASONS[verdict],
        'name': 'bench',
        'inputs': {'sets': ['bench'], 'params': 'config/ae0505d16.yaml',
                   'actuator': 'NEC/TOKIN AE0505D16'},
        'records': [_record(recording) for recording in recordings],
        'preflight': [
            {'file': 'bench/steps.csv', 'row': 12043, 'severity': 'repaired',
             'what': '3 rows have the time of the row before', 'mend': 'the first was kept'},
            {'file': 'bench/multisine.csv', 'row': None, 'severity': 'note',
             'what': 'displacement has 0.3 nm steps', 'mend': 'counted as noise'}],
        'gap': gap,
        'where': {
            'block': max(shares, key=shares.get) if found else None,
            'shares': shares,
            'blocks': {
                'drive': {'over_noise': 1.02, 'ci': [0.98, 1.06], 'from': ['voltage_command'],
                          'to': 'voltage'},
                'electrical': {'over_noise': 1.0 if not found else 14.2, 'ci': [0.9, 15.1],
                               'from': ['voltage'], 'to': 'charge'},
                'transducer': {'over_noise': 1.08, 'ci': [0.97, 1.2], 'from': ['charge'],
                               'to': 'displacement'},
                'mechanical': {'over_noise': 1.4, 'ci': [1.2, 1.7],
                               'from': ['external_force', 'charge'], 'to': 'displacement'},
                'environment': {'over_noise': None, 'ci': None, 'note': 'not cut out'},
                'sensor': {'over_noise': None, 'note': 'seen only with the mechanical block'}},
            'channels': {'displacement': 0.52, 'charge': 0.47, 'voltage': 0.01},
            'bands': [
                {'low': 0.0, 'high': 1.0, 'share': 0.81, 'over_noise': 38.0},
                {'low': 1.0, 'high': 10.0, 'share': 0.11, 'over_noise': 11.0},
                {'low': 10.0, 'high': 100.0, 'share': 0.05, 'over_noise': 3.1},
                {'low': 100.0, 'high': 1000.0, 'share': 0.02, 'over_noise': 1.3},
                {'low': 1000.0, 'high': None, 'share': 0.01, 'over_noise': 1.0}],
            'regimes': [
                {'name': 'more than 1 s after a step', 'share': 0.71, 'ratio': 1.9},
                {'name': 'falling', 'share': 0.58, 'ratio': 1.1, 'channel': 'displacement'},
                {'name': 'near reversals', 'share': 0.09, 'ratio': 0.4},
                {'name': 'high bias', 'share': 0.43, 'ratio': 1.2}],
            'records': {'steps': 0.79, 'triangle': 0.12, 'decay': 0.04, 'force': 0.03,
                        'multisine': 0.02}},
        'isolability': {'classes': [['thermal_drift', 'sensor_drift'],
                                    *([tied] if tied else [])],
                        'undetectable': ['contact', 'stiffness_hardening']},
        'calibration': {
            'stiffness': {'nominal': 6e6, 'fitted': 6.041e6, 'ci': [5.91e6, 6.17e6],
                          'unit': 'N/m', 'allowed': 0.02, 'at_bound': False,
                          **({'corrected': 6.014e6} if selected else {})},
            'damping': {'nominal': 150.0, 'fitted': 153.0, 'ci': [148.2, 156.0],
                        'unit': 'N s/m', 'allowed': 0.02, 'at_bound': 'upper'},
            'linear_capacitance': {'nominal': 1.2e-6, 'fitted': 1.197e-6,
                                   'ci': [1.19e-6, 1.205e-6], 'unit': 'F', 'allowed': 0.02},
            'transformer_ratio': {'nominal': 10.0, 'fitted': 10.02, 'ci': None, 'unit': 'C/m'}},
        'causes': [_cause(row, index, verdict) for index, row in enumerate(CANDIDATES)],
        'selected': selected,
        'ambiguity_set': tied or selected,
        'shrinkage': {
            **{channel: _shrinkage(gap[channel], left[channel]) for channel in NOISE},
            'placebo': {'displacement': 0.012, 'charge': 0.004, 'voltage': None},
            'ceiling': {'displacement': 0.991, 'charge': 0.987, 'voltage': None},
            'withheld': ['the last third of triangle', 'the second half of steps', 'force']},
        'remaining': {'gap': left, 'block': None, 'structured': verdict == 'UNKNOWN',
                      'note': 'largest just after the steps'},
        'next_experiment': None if verdict == 'NO_GAP' else {
            'profile': 'steps', 'settings': {'amplitude': 90.0, 'hold': 60.0, 'repeat': True},
            'add_channel': 'charge' if verdict == 'AMBIGUOUS' else None,
            'separates': tied or ['creep', 'mount_creep'], 'separation': 14.2,
            'command': 'piezo_stack excite steps --amplitude 90 --hold 60 --out next',
            'why': 'creep follows the charge, the glue does not',
            'alternatives': [
                {'profile': 'triangle', 'settings': {'frequency': 0.1}, 'add_channel': None,
                 'separates': tied or ['creep', 'mount_creep'], 'separation': 5.1}]},
        'how': {'version': '0.1.0', 'seed': 0,
                'command': 'piezo_stack diagnose bench --params config/ae0505d16.yaml --out out',
                'settings': {'starts': 4, 'folds': 3, 'noise_model': 'AR(1)'},
                'steps': ['Preflight read 5 recordings with 62,000 rows.',
                          'Each block was driven by measured signals.',
                          'Nominal parameters were tuned within 2 %.',
                          'Every effect of the library was fitted from four starts.']},
        'files': {'diagnosis': 'out/diagnosis.json', 'report': 'out/report.html',
                  'parameters': 'out/corrected.yaml'},
        'traces': traces,
        'warnings': ['damping sits at its bound: the mount may damp more than the stack does'],
    }


_REASONS = {
    'NO_GAP': 'no channel differs from the simulation by more than its noise',
    'CAUSE': 'creep predicts the withheld data better than any other effect and any pair',
    'MULTIPLE': 'the pair predicts the withheld data better than either effect alone',
    'AMBIGUOUS': 'without charge, creep of the ceramic and of the glue move the stack alike',
    'UNKNOWN': 'the best candidate removes less than half of what a flexible correction removes',
    'NOT_IDENTIFIABLE': 'one recording without a force leaves five effects that look alike',
}


def _programmes(random):
    """Return time, voltage and force of the five programmes, at a tenth of a laboratory's rate."""
    time = np.arange(0, 0.6, 1e-4)
    triangle = np.array([30, 60, 90])[np.minimum(time // 0.2, 2).astype(int)]
    triangle = triangle * (1 - np.abs(2 * ((10 * time) % 1) - 1))
    decay = np.arange(0, 0.3, 5e-5)
    steps = np.arange(0, 30, 2e-3)
    levels = np.array([0, 30, 60, 90, 40, 10])[np.minimum(steps // 5, 5).astype(int)]
    smooth = np.convolve(np.pad(levels, 5, mode='edge'), np.hanning(11) / 5, 'valid')
    sines = np.arange(0, 0.3, 2e-5)
    phases = random.uniform(0, 2 * np.pi, 60)
    tones = 20 * np.geomspace(1, 250, 60).astype(int)
    multisine = 40 + 0.8 * np.sin(2 * np.pi * tones * sines[:, None] + phases).sum(axis=1)
    pull = np.arange(0, 0.5, 1e-4)
    return {
        'triangle': (time, triangle, 0 * time),
        'decay': (decay, 45 + 45 * np.exp(-8 * decay) * np.sin(200 * np.pi * decay), 0 * decay),
        'steps': (steps, smooth, 0 * steps),
        'multisine': (sines, multisine, 0 * sines),
        'force': (pull, np.full_like(pull, 40.0), -100 * (1 - np.cos(20 * np.pi * pull))),
    }


def _loop(voltage):
    """Return a hysteretic answer of unit gain: play operators of several widths."""
    answer = 0.6 * voltage
    for width in (2.0, 5.0, 10.0, 20.0):
        play = np.empty_like(voltage)
        held = max(voltage[0] - width / 2, 0.0)
        for row, value in enumerate(voltage):
            held = min(max(held, value - width / 2), value + width / 2)
            play[row] = held
        answer = answer + 0.1 * play
    return answer


def _relaxations(time, drive):
    """Return the sum of first-order answers with one time constant a decade."""
    step = time[1] - time[0]
    total = np.zeros_like(drive)
    for constant in (0.01, 0.1, 1.0, 10.0):
        pole, state = np.exp(-step / constant), 0.0
        for row, value in enumerate(drive):
            state = pole * state + (1 - pole) * value
            total[row] += state
    return total


def _gap(recordings, simulated, channel):
    errors = np.concatenate([recording.measured[channel] - answer[channel]
                             for recording, answer in zip(recordings, simulated)])
    span = max(np.ptp(recording.measured[channel]) for recording in recordings)
    rms = float(np.sqrt(np.mean(errors ** 2)))
    ratio = rms / NOISE[channel]
    return {'rms': rms, 'nrmse': float(rms / span), 'noise_rms': NOISE[channel],
            'over_noise': ratio, 'ci': [0.97 * ratio, 1.03 * ratio]}


def _shrinkage(gap, left):
    before, after, noise = (value ** 2 for value in
                            (gap['rms'], left['rms'], gap['noise_rms']))
    wide = gap['over_noise'] > 1.1
    score = 1 - (after - noise) / (before - noise) if wide else None
    return {'before': before, 'after': after, 'noise': noise, 'S': score,
            'ci': [score - 0.02, min(score + 0.015, 1.0)] if wide else None,
            'span': gap['rms'] / gap['nrmse']}


def _cause(row, index, verdict):
    effect, block, summary, parameters = row
    chances = PROBABILITY[verdict]
    score = 0.0 if verdict == 'NO_GAP' else 4120.0 * 0.5 ** index
    return {
        'effect': effect, 'block': block, 'summary': summary,
        'probability': chances[index] if index < len(chances) else 0.0,
        'parameters': {name: {
            'value': value, 'unit': unit, 'ci': [0.95 * value, 1.04 * value],
            'at_bound': value in (lower, upper), 'neutral': neutral, 'lower': lower,
            'upper': upper} for name, (value, unit, neutral, lower, upper) in parameters.items()},
        'delta_log_score': score, 'se': 12.0 + index, 'S': 0.97 * 0.8 ** index}


def _record(recording):
    return {'name': recording.name, 'source': recording.source, 'drive': recording.drive,
            'rows': len(recording), 'duration': recording.duration, 'rate': recording.rate,
            'channels': list(recording.measured), 'has_force': recording.has_force,
            'role': 'withheld' if recording.name == 'force' else 'both'}
