# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The test programmes: what they command, and that they are the ones of the references."""

from pathlib import Path

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.programmes import force, multisine, PROGRAMMES, steps, triangle
import pytest

REFERENCE = Path(__file__).resolve().parents[2] / 'shared' / 'reference'


@pytest.mark.skipif(not REFERENCE.is_dir(), reason='the reference recordings are not here')
@pytest.mark.parametrize('name', PROGRAMMES)
def test_a_programme_is_the_one_of_the_reference_recordings(name):
    from piezo_stack_sim.recording.read import read_set
    made = PROGRAMMES[name]()
    reference = read_set(REFERENCE)[name]
    assert np.array_equal(made.time, reference.time)
    assert np.abs(made.external_force - reference.external_force).max() < 1e-6
    if name == 'multisine':  # its phases are drawn anew: the same lines of the same size
        made, reference = (_spectrum(each.command) for each in (made, reference))
        assert np.array_equal(made > 0.01, reference > 0.01)
    else:
        assert np.abs(made.command - reference.command).max() < 1e-6


def _spectrum(command):
    return np.abs(np.fft.rfft(command[-5000:])) / 2500.0


def test_a_triangle_returns_to_exactly_zero_and_reaches_its_peaks():
    made = triangle(peaks=(10.0, 20.0), frequency=100.0, cycles=1, rate=10e3)
    assert made.command[50] == 10.0 and made.command[100] == 0.0 and made.command[150] == 20.0


def test_steps_move_smoothly_and_hold():
    made = steps(levels=(0.0, 50.0), hold=1.0, transition=0.1)
    assert np.abs(np.diff(made.command)).max() < 50.0 * np.pi / 2.0 / 100.0 + 1e-9
    assert np.all(made.command[1100:] == 50.0) and np.all(made.command[:1000] == 0.0)


def test_steps_without_a_transition_step_at_once():
    made = steps(levels=(0.0, 50.0, 20.0), hold=0.1, transition=0.0)
    assert np.array_equal(made.command, np.repeat([0.0, 50.0, 20.0], 100))


def test_a_multisine_repeats_and_keeps_its_peak():
    made = multisine(bias=30.0, peak=5.0, periods=3)
    assert np.abs(made.command[1000:] - 30.0).max() == pytest.approx(5.0)
    assert np.array_equal(made.command[5000:10000], made.command[10000:])
    assert np.array_equal(made.command, multisine(bias=30.0, peak=5.0, periods=3).command)


def test_the_force_squeezes_and_lets_go():
    made = force(squeeze=80.0)
    assert made.has_force and made.external_force.max() == 0.0
    assert made.external_force.min() == pytest.approx(-80.0)


@pytest.mark.parametrize('make', [
    lambda: triangle(frequency=30.0, rate=1000.0),  # 33.3 rows a cycle
    lambda: multisine(band=(20.0, 40e3)),
    lambda: triangle(frequency=0.0),
    lambda: triangle(peaks=()),
    lambda: triangle(frequency=1e-300),
    lambda: triangle(cycles=10**8),
    lambda: steps(levels=()),
    lambda: force(frequency=np.nan),
    lambda: multisine(seed=-1),
    lambda: multisine(lines=10**7),
])
def test_a_programme_that_does_not_fit_its_rows_is_refused(make):
    with pytest.raises(InputError, match='expected'):
        make()
