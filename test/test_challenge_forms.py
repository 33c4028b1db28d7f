# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""No inverse crime: hidden effect and fitted effect of one name are not the same equations."""

import numpy as np
from piezo_stack_sim.challenge import programmes
from piezo_stack_sim.challenge.device import respond, Unit
from piezo_stack_sim.challenge.foreign import FOREIGN
from piezo_stack_sim.challenge.hidden import Context, Range
from piezo_stack_sim.challenge.known import KNOWN
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.fit import Fitter
from piezo_stack_sim.gap.lacking.in_series import capacitor_in_series
from piezo_stack_sim.gap.measured.evidence import prepare
from piezo_stack_sim.gap.measured.forward import simulate_set
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording.recording import Recording
import pytest
from scipy.optimize import least_squares

CONTEXT = Context(top=90.0, stroke=1.24e-5)
#: What good instruments can tell: a fit to the noise floor is at most 1 in these units.
FLOOR = {'voltage': 3e-3, 'charge': 1e-8, 'displacement': 1e-9}
PLAN = programmes.Plan(
    triangle_rate=5e3, triangle_frequency=20.0, triangle_peaks=(60.0, 90.0), decay_rate=10e3,
    decay_frequency=200.0, steps_rate=200.0, steps_hold=2.0, steps_levels=(0.0, 60.0, 20.0),
    multisine_rate=20e3, multisine_top=3000.0, force_rate=5e3, force_frequency=20.0)
RECORDINGS = dict(zip(programmes.NAMES, programmes.programmes(PLAN)))

#: Effect: recordings that show it, hidden parameters, where the fit of the library's starts.
#: (Not `initial_polarisation`: what any history leaves is the strain of each element, whichever
#: way it is said, and the library has those for numbers. `amplifier_gain` without offset:
#: here that is followed before the first row, there from it on, which alone tells them apart.)
CASES = {
    'command_delay': ('multisine', {'delay': 9e-5, 'share': 0.4, 'phase': 0.3}, {'delay': 8e-5}),
    'amplifier_current_limit': ('decay multisine',
                                {'limit': 0.03, 'sinks': 0.8, 'resistance': 15.0,
                                 'first': 0.2, 'second': 0.1, 'third': 0.01},
                                {'limit': 0.03, 'sink_share': 0.8, 'output_resistance': 12.0}),
    'amplifier_saturation': ('triangle', {'rail': 80.0, 'knee': 0.7},
                             {'upper': 80.0, 'knee': 1.0}),
    'amplifier_gain': ('triangle', {'gain_error': 0.02, 'offset': 0.0, 'curvature': 0.18},
                       {'gain_error': 0.02, 'offset': 2e-3, 'curvature': -5e-4}),
    'creep': ('decay steps', {'per_decade': 0.015, 'onset': 4e-3},
              {'gain_per_decade': 0.015, 'reference_time': 3e-3, 'onset': 3e-3, 'power': -0.02}),
    'rate_dependent_hysteresis': ('triangle decay', {'growth': 0.06, 'reference': 8e-3},
                                  {'resistance': 2.0, 'dispersion': 2e-3, 'growth': 0.03,
                                   'exponent': 0.5}),
    'asymmetric_hysteresis': ('triangle', {'bow': 1.5, 'charge': 4e-5, 'branch': 0.02},
                              {'quadratic': 0.04, 'cubic': 0.03, 'branch': 0.05}),
    'transducer_nonlinearity': ('triangle force', {'share': 0.03, 'balanced_at': 1.0},
                                {'curvature': -0.005}),
    'transducer_ratio': ('triangle force', {'error': 0.1, 'inequality': 0.1, 'pressure': 1500.0},
                         {'ratio_error': 0.1, 'inequality': 0.08}),
    'added_mass': ('multisine', {'mass': 0.04, 'joint_frequency': 5e4},
                   {'mass': 0.04, 'joint_frequency': 5e4}),
    'series_compliance': ('force', {'stiffness': 1e8, 'load': 60.0},
                          {'compliance': 5e-9, 'stiffening': 0.01}),
    'parallel_stiffness': ('triangle', {'stiffness': 4e6, 'length': 6e-5}, {'stiffness': 5e6}),
    'stiffness_hardening': ('triangle', {'force': 40.0, 'power': 4.5},
                            {'quadratic': -0.05, 'cubic': 0.2}),
    'friction': ('triangle force', {'force': 5.0, 'way': 9e-8, 'mix': 0.7, 'turn': 0.035},
                 {'coulomb_force': 4.0}),
    'mechanical_resonance': ('multisine', {'participation': 0.3, 'frequency': 1000.0,
                                           'spread': 1.7, 'second': 0.25, 'damping': 0.03,
                                           'way': 8e-6},
                             {'participation': 0.25, 'frequency': 1000.0, 'damping_ratio': 0.05,
                              'second_participation': 0.08, 'second_frequency': 1700.0,
                              'second_damping_ratio': 0.05}),
    'contact': ('triangle', {'gap': 7e-6, 'force': 20.0, 'roughness': 2e-7},
                {'gap': 7e-6, 'stiffness': 2e7, 'exponent': 1.5}),
    'mount_creep': ('decay steps', {'stiffness': 2e6, 'time': 20.0, 'mix': 0.12, 'way': 4e-6,
                                    'nominal_after': 0.1},
                    {'gain_per_decade': 0.02, 'power': 0.1, 'onset': 0.01,
                     'reference_time': 0.1}),
    'sensor_lag': ('multisine', {'time_constant': 1.5e-4, 'quality': 0.65, 'head': 0.3},
                   {'time_constant': 1.5e-4, 'quality_factor': 0.6}),
    'sensor_delay': ('multisine', {'delay': 8e-5, 'share': 0.5}, {'delay': 8e-5}),
    'sensor_nonlinearity': ('triangle', {'size': 3e-7, 'length': 1.3e-5},
                            {'quadratic': 0.05, 'cubic': -0.05, 'quartic': -2e-3}),
}


#: Both fits of these take ten seconds or more: every commit runs some of them.
LENGTHY = {'friction', 'mechanical_resonance', 'amplifier_current_limit', 'creep',
           'transducer_nonlinearity', 'transducer_ratio', 'mount_creep', 'asymmetric_hysteresis',
           'rate_dependent_hysteresis', 'sensor_lag', 'added_mass'}


def stacked(responses):
    """Return channels of several recordings as one vector: its norm squared adds mean squares."""
    return np.concatenate([channels[name] / FLOOR[name] / np.sqrt(channels[name].size)
                           for channels in responses for name in FLOOR])


def hidden_response(key, parameters, names):
    """Return what a device does in which the challenge hides an effect."""
    unit = KNOWN[key].apply(Unit(), **parameters)
    return stacked(respond(unit, RECORDINGS[name]) for name in names)


def library_response(key, parameters, names):
    """Return what the plant does with the library's effect of that name."""
    return response_of(Device.nominal().with_effects({key: parameters}), names)


def response_of(device, names):
    """Return what the plant does, as one vector."""
    out = []
    for name in names:
        programme = RECORDINGS[name]
        answer = simulate(device, programme.time, programme.command, programme.force,
                          drive='voltage')
        out.append({'voltage': answer.voltage, 'charge': answer.charge - answer.charge[0],
                    'displacement': answer.displacement - answer.displacement[0]})
    return stacked(out)


def fit(respond_to, target, start, lower, upper):
    """Return the smallest distance from a target, and the parameters (dict) there."""
    names = list(start)
    sign = np.array([-1.0 if start[name] < 0.0 else 1.0 for name in names])
    # In the logarithm, so that a micrometre and a giganewton are alike.
    low = np.log([max(lower[name], 1e-3 * abs(start[name])) for name in names])
    high = np.log([min(upper[name], 1e3 * abs(start[name])) for name in names])
    at = np.clip(np.log(np.abs([start[name] for name in names])), low + 1e-6, high - 1e-6)

    def values(walk):
        return dict(zip(names, (sign * np.exp(walk)).tolist()))

    found = least_squares(lambda walk: respond_to(values(walk)) - target, at, bounds=(low, high),
                          diff_step=2e-3, max_nfev=15)
    return np.sqrt(2.0 * found.cost), values(found.x)


def both_ways(key):
    """Return how far each form stays from the other at best, in units of the noise floor."""
    recordings, parameters, start = CASES[key]
    names = recordings.split()
    hidden = hidden_response(key, parameters, names)
    wide = dict.fromkeys(start, 0.0), dict.fromkeys(start, np.inf)
    there, fitted = fit(lambda values: library_response(key, values, names), hidden, start, *wide)
    ranges = {name: given for name, given in KNOWN[key].ranges.items()
              if isinstance(given, Range) and parameters[name] != 0.0 and name != 'phase'}
    scale = {name: getattr(CONTEXT, given.of) if given.of else 1.0
             for name, given in ranges.items()}
    target = library_response(key, fitted, names)
    back, _ = fit(
        lambda values: hidden_response(key, {**parameters, **values}, names), target,
        {name: parameters[name] for name in ranges},
        {name: scale[name] * max(given.low, 1e-3) if given.low <= 0.0 else scale[name] * given.low
         for name, given in ranges.items()},
        {name: scale[name] * given.high for name, given in ranges.items()})
    return there, back


@pytest.mark.parametrize('key', [
    pytest.param(key, marks=[] if key not in LENGTHY else [pytest.mark.slow])
    for key in sorted(CASES)])
def test_the_fitted_form_cannot_be_the_hidden_one(key):
    """Each fits the other at best to several times what good instruments can tell."""
    there, back = both_ways(key)
    assert there > 1.0, f'the library fits the hidden form to {there:.2f} of the noise floor'
    assert back > 1.0, f'the hidden form fits the library to {back:.2f} of the noise floor'


def test_that_is_more_than_half_of_the_library():
    """As many effects are compared as the benchmark's claim needs."""
    assert len(CASES) > len(EFFECTS) / 2
    assert set(CASES) <= set(EFFECTS)


def test_a_capacitor_in_series_is_a_spring_with_a_smaller_ratio():
    """The library has no such capacitor, and no channel of the best instruments misses it."""
    names, capacitance = ('triangle', 'steps', 'multisine', 'force'), 1e-4
    unit = FOREIGN['sense_capacitor'].apply(Unit(), capacitance=capacitance)
    hidden = stacked(respond(unit, RECORDINGS[name]) for name in names)
    actuator = Device.nominal().actuator
    smaller = 1.0 + actuator.linear_capacitance / capacitance
    spring = actuator.transformer_ratio ** 2 / (capacitance + actuator.linear_capacitance)
    twin = Device.nominal().replace(actuator=actuator.replace(
        transformer_ratio=actuator.transformer_ratio / smaller,
        linear_capacitance=actuator.linear_capacitance / smaller)).with_effects(
            {'parallel_stiffness': {'stiffness': spring}})
    assert np.linalg.norm(response_of(Device.nominal(), names) - hidden) > 100.0
    assert np.linalg.norm(response_of(twin, names) - hidden) < 1.0


@pytest.mark.parametrize('key, values, better', [
    ('sense_capacitor', {'capacitance': 4e-5}, True),
    ('parallel_stiffness', {'stiffness': 4e6, 'length': 6e-5}, False)])
def test_a_hidden_capacitor_is_told_from_a_hidden_spring_by_what_must_be_re_tuned(
        key, values, better):
    """As the generator makes them, with the noise of good instruments."""
    unit = (FOREIGN | KNOWN)[key].apply(Unit(), **values)
    recordings = []
    for seed, name in enumerate(('triangle', 'steps', 'multisine', 'force')):
        played, random = RECORDINGS[name], np.random.default_rng(seed)
        recordings.append(Recording(
            name, played.time, 'voltage', played.command, external_force=played.force,
            measured={channel: clean + FLOOR[channel] * random.standard_normal(clean.size)
                      for channel, clean in respond(unit, played).items()}, source=name))
    device = Device.nominal()
    fitter = Fitter(device, prepare(recordings, simulate_set(device, recordings), device))
    fitter.prepare(parallel)
    spring = fitter.fit({'parallel_stiffness': {'stiffness': 1e6}})
    found = capacitor_in_series(fitter, spring)
    assert found.chance < 0.05 if better else found.chance > 0.95
    if better:
        assert found.farads == pytest.approx(values['capacitance'], rel=0.2)
