# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Transducer, masses, springs, stops and mounts, against published or recomputed numbers."""

import math
from types import SimpleNamespace

from effect_probes import at, device, fundamental, IDEAL, ringing, sine, stroke, triangle
import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.plant import Plant, simulate
from piezo_stack_sim.plant.build import build_model
import pytest
from scipy.integrate import solve_ivp

DECADES = np.concatenate([[0.0], np.logspace(-2, 2, 41)])

SOURCE = {'output_resistance': 50.0}  # ohm, keeps a step from ringing past its end


def test_a_charge_drive_leaves_the_bow_of_the_transducer():
    time, wave = triangle(10.0, 1.0, 2, 1000)
    charge = 1.3e-4 * wave
    plain = simulate(IDEAL, time, charge, drive='charge')
    bowed = simulate(device('transducer_nonlinearity'), time, charge, drive='charge')
    departure = np.abs(bowed.displacement - plain.displacement).max() / np.ptp(plain.displacement)
    assert 0.01 < departure < 0.05  # published: at most 4.65 %
    # A function of the charge: no loop, but for the ringing of the stairs.
    rise, fall = bowed.displacement[1:501], bowed.displacement[502:1002][::-1]
    assert np.abs(rise - fall).max() < 1e-3 * np.ptp(rise)


def test_a_transducer_ratio_changes_both_directions():
    charge = np.full(200, 1e-4)
    time = np.arange(200) * 1e-4
    ideal = simulate(IDEAL, time, charge, drive='charge').displacement[-1]
    off = simulate(device('transducer_ratio', ratio_error=0.1), time, charge, drive='charge')
    ratio, spring = 11.0, 6e6 * 1.2e-6
    assert off.displacement[-1] / 1e-4 == pytest.approx(ratio / (ratio ** 2 + spring), rel=1e-6)
    assert off.displacement[-1] < ideal


@pytest.mark.parametrize('more', [{}, {'amplifier_bandwidth': {'output_resistance': 20.0}}])
def test_unequal_directions_are_a_scale_of_the_displacement_and_another_of_the_force(more):
    """Scales of x and F in Eqs. 11, 14 and 15 make the geometric mean of the two ratios."""
    converse, direct = 1.0 + 0.1 * 1.2, 1.0 + 0.1 * 0.8
    time, voltage = triangle(100.0, 60.0, 1, 500)
    force = 80.0 * np.sin(2.0 * np.pi * 130.0 * time)
    unequal = simulate(IDEAL.with_effects({
        'transducer_ratio': {'ratio_error': 0.1, 'inequality': 0.2}, **more}),
        time, voltage, force)
    scale = np.sqrt(converse / direct)
    equal = simulate(IDEAL.with_effects({
        'transducer_ratio': {'ratio_error': np.sqrt(converse * direct) - 1.0}, **more}),
        time, voltage, force / scale)
    # Rounding decides when a slip is noticed: a picometre.
    np.testing.assert_allclose(unequal.displacement, scale * equal.displacement, atol=1e-12)
    np.testing.assert_allclose(unequal.charge, equal.charge, atol=1e-11)
    np.testing.assert_allclose(unequal.voltage, equal.voltage, atol=1e-6)
    np.testing.assert_allclose(unequal.force, scale * equal.force, atol=1e-5)


def test_added_mass_lowers_the_natural_frequency():
    expected = math.sqrt(89.3333e6 / (0.00375 + 0.05)) / (2.0 * math.pi)
    assert ringing(device('added_mass', mass=0.05)) == pytest.approx(expected, rel=0.02)


def test_a_payload_on_a_joint_swings_as_two_masses_on_springs_do():
    m, mass, stiffness = 0.00375, 0.05, 89.3333e6
    joint = m * mass / (m + mass) * (2.0 * math.pi * 2e4) ** 2
    slow, _ = np.linalg.eigvalsh(np.array([
        [(stiffness + joint) / m, -joint / math.sqrt(m * mass)],
        [-joint / math.sqrt(m * mass), joint / mass]]))  # stiffness over masses, symmetrical
    swinging = ringing(device('added_mass', mass=mass, joint_frequency=2e4))
    assert swinging == pytest.approx(math.sqrt(slow) / (2.0 * math.pi), rel=0.01)
    assert swinging < 0.85 * ringing(device('added_mass', mass=mass))


def test_a_payload_on_a_stiff_joint_is_a_rigid_one():
    held, rigid = (ringing(device('added_mass', mass=0.05, joint_frequency=frequency))
                   for frequency in (1.9e5, math.inf))
    assert held == pytest.approx(rigid, rel=0.01)


def test_a_series_compliance_softens_against_forces_and_keeps_the_free_stroke():
    soft = device('series_compliance', compliance=5e-9, stiffening=0.0)
    assert stroke(soft) == pytest.approx(stroke(IDEAL), rel=1e-6)
    time = np.arange(400) * 1e-4
    force = np.full(400, -100.0)
    moved = [simulate(target, time, np.zeros(400), force, drive='open').displacement[-1]
             for target in (IDEAL, soft)]
    assert moved[1] - moved[0] == pytest.approx(-100.0 * 5e-9, rel=1e-6)


@pytest.mark.parametrize('load', [{}, {'mass': 0.05, 'damping': 200.0}])
@pytest.mark.parametrize('force', [-100.0, -20.0, 40.0])
def test_a_joint_that_closes_gives_way_by_a_hyperbola_of_the_force(force, load):
    def moved(**values):
        target = device('series_compliance', **values).replace(load=load)
        return simulate(target, np.arange(2000) * 1e-4, np.zeros(2000), np.full(2000, force),
                        drive='open').displacement[-1]

    rigid = moved(compliance=0.0, stiffening=0.02)
    given = moved(compliance=5e-9, stiffening=0.02) - rigid
    assert given == pytest.approx(5e-9 * force / (1.0 + 0.02 * abs(force)), rel=1e-3)
    assert moved(compliance=5e-9, stiffening=0.0) - rigid == pytest.approx(5e-9 * force, rel=1e-3)


def test_a_joint_that_closes_answers_row_by_row_as_all_at_once():
    target = device('series_compliance', compliance=5e-9, stiffening=0.02)
    target = target.replace(load={'mass': 0.05, 'damping': 20.0})
    rows = np.arange(60)
    command, force = 30.0 * np.sin(0.1 * rows), 50.0 * np.sin(0.3 * rows)
    plant = Plant(target, 1e-4, 'voltage', noise=False)
    one_by_one = [plant.advance(u, f).displacement for u, f in zip(command, force)]
    together = Plant(target, 1e-4, 'voltage', noise=False).run(command, force).displacement
    assert np.abs(together).max() > 1e-7
    assert np.abs(one_by_one - together).max() < 1e-15


@pytest.mark.parametrize('sensor', [
    {'time_constant': 4e-3}, {'time_constant': 2e-3, 'quality_factor': 0.9},
    {'time_constant': 2e-3, 'quality_factor': 0.3},
    {'time_constant': 4e-3, 'quality_factor': 0.65}])
@pytest.mark.parametrize('quality', [0.0, 0.4, 0.65])
def test_another_filter_before_a_device_at_rest_shows_what_the_one_before_did(quality, sensor):
    bowed = device('transducer_nonlinearity', curvature=0.1)
    plant = Plant(bowed.with_effects({'sensor_lag': {
        'time_constant': 2e-3, 'quality_factor': quality}}), 1e-3, 'voltage', noise=False)
    before = plant.run(np.full(60, 60.0)).displacement[-1]
    plant.set_device(bowed.with_effects({'sensor_lag': sensor}))
    assert plant.run(np.full(60, 60.0)).displacement == pytest.approx(before, abs=1e-12)


def test_a_preload_spring_takes_its_share_of_the_stroke():
    loss = 1.0 - stroke(device('parallel_stiffness')) / stroke(IDEAL)
    assert 0.08 < loss < 0.12  # 5 N/um: 9 % with 49 N/um, 12 % with 37 N/um
    assert 1.0 - stroke(device('parallel_stiffness', stiffness=1e6)) / stroke(
        IDEAL) == pytest.approx(0.023, abs=0.005)


def test_a_hardening_spring_stiffens_by_what_it_says():
    model = build_model(device('stiffness_hardening', quadratic=0.2, cubic=0.1))
    k2, k3 = model.smooth_force
    x, k_s = model.reference.stroke, model.reference.stiffness
    assert (2.0 * k2 * x + 3.0 * k3 * x ** 2) / k_s == pytest.approx(0.3)
    assert stroke(device('stiffness_hardening', cubic=0.2)) < stroke(
        device('stiffness_hardening', cubic=0.1)) < stroke(IDEAL)


def test_friction_holds_the_position_back_at_every_speed():
    gaps = []
    for frequency in (1.0, 10.0):
        time, voltage = triangle(frequency, 90.0, 3, 2000)
        plain = simulate(IDEAL, time, voltage).displacement[4000:]
        rubbed = simulate(device('friction'), time, voltage).displacement[4000:]
        gaps.append((plain - rubbed)[500] - (plain - rubbed)[1500])
    # 5 N both ways over the stiffness of the driven stack, 37 to 75 N/um.
    assert 2 * 5.0 / 75e6 < gaps[0] < 2 * 5.0 / 37e6 * 1.15
    assert gaps[1] == pytest.approx(gaps[0], rel=0.02)


@pytest.mark.parametrize('damping_ratio', [0.01, 0.05])
def test_quality_of_a_resonance_is_that_of_its_damping_ratio(damping_ratio):
    target = device('mechanical_resonance', participation=1.0, frequency=2000.0,
                    damping_ratio=damping_ratio)
    cycles = round(3.0 / damping_ratio)
    time, voltage = sine(2000.0, 0.0, 2.0, cycles, 100)
    gain = [abs(fundamental(time, simulate(dev, time, voltage).displacement, 2000.0, 4))
            for dev in (IDEAL, target)]
    assert gain[1] / gain[0] == pytest.approx(0.5 / damping_ratio, rel=0.02)


@pytest.mark.parametrize('frequency', [1500.0, 2000.0, 3300.0])
def test_two_modes_of_a_structure_add_up_and_neither_moves_the_other(frequency):
    first = {'participation': 0.3, 'frequency': 2000.0, 'damping_ratio': 0.02}
    second = {'second_participation': -0.1, 'second_frequency': 3300.0,
              'second_damping_ratio': 0.05}
    time, voltage = sine(frequency, 0.0, 2.0, 150, 100)
    plain, rings = (fundamental(time, simulate(dev, time, voltage).displacement, frequency, 4)
                    for dev in (IDEAL, device('mechanical_resonance', **first, **second)))

    def swing(part, natural, ratio):
        at = frequency / natural
        return part * (1.0 / (1.0 - at ** 2 + 2.0j * ratio * at) - 1.0)

    assert rings / plain == pytest.approx(
        1.0 + swing(*first.values()) + swing(*second.values()), rel=0.02)


def test_a_stop_is_met_at_its_gap():
    time, voltage = triangle(1.0, 90.0, 2, 2000)
    plain = simulate(IDEAL, time, voltage).displacement
    stopped = simulate(device('contact', gap=8e-6, stiffness=1e9), time, voltage).displacement
    before = np.argmax(plain > 8e-6) - 1
    assert np.abs(stopped - plain)[:before].max() < 1e-12
    assert 8.0e-6 < stopped.max() < 8.3e-6


@pytest.mark.parametrize('exponent', [1.0, 1.5, 1.9])
def test_a_stop_pushes_back_with_the_power_of_the_indentation(exponent):
    time, voltage = triangle(0.1, 90.0, 2, 2000)
    gap, stiffness = 7e-6, 3e7
    answer = simulate(device('contact', gap=gap, stiffness=stiffness, exponent=exponent),
                      time, voltage)
    q, x = answer.charge, answer.displacement
    # At rest Eqs. 11, 14 and 15 leave the stop what the transducer has over the spring.
    pushed = 10.0 * (q - 10.0 * x) / 1.2e-6 - 6e6 * x
    deep = np.maximum(x - gap, 0.0)
    assert deep.max() > 1e-6
    assert pushed == pytest.approx(stiffness * deep * (deep / 1e-6) ** (exponent - 1.0), abs=1e-3)


def test_the_end_bounces_on_a_ball_as_its_equation_of_motion_says():
    time = np.linspace(0.0, 1e-3, 1001)
    charge = 8e-5  # at once, so that the end swings about 7.5 um
    target = device('contact', gap=6e-6, stiffness=4e7, exponent=1.5)

    def motion(_, state):
        x, w = state
        stop = 4e10 * max(x - 6e-6, 0.0) ** 1.5
        return w, (10.0 * (charge - 10.0 * x) / 1.2e-6 - 6e6 * x - 150.0 * w - stop) / 3.75e-3

    exact = solve_ivp(motion, (0.0, 1e-3), (0.0, 0.0), t_eval=time, rtol=1e-10, atol=1e-16,
                      max_step=2e-7).y[0]
    assert exact.max() > 8e-6 and 6e-6 < exact[-1]
    answer = simulate(target, time, np.full(time.size, charge), drive='charge')
    assert answer.displacement == pytest.approx(exact, abs=2e-10)


def test_a_mount_creeps_more_in_displacement_than_in_charge():
    target = device('mount_creep', power=0.0).with_effects({'amplifier_bandwidth': SOURCE})
    response = simulate(target, DECADES, np.full(DECADES.size, 90.0))
    shares = []
    for y in (response.displacement, response.charge):
        shares.append((at(DECADES, y, 10.0) - at(DECADES, y, 1.0)) / at(DECADES, y, 0.1))
    assert shares[0] == pytest.approx(0.01, rel=0.1)
    # What the motion draws at constant voltage: dq = T/(1 + C K) dx (Eqs. 11, 12).
    drawn = 10.0 / (1.0 + 1.2e-6 * 0.5e6) * 12.4e-6 / 133e-6
    assert shares[1] / shares[0] == pytest.approx(drawn, rel=0.03)


def test_a_mount_that_yields_with_a_power_of_time_gives_less_in_each_decade():
    target = device('mount_creep', power=0.1).with_effects({'amplifier_bandwidth': SOURCE})
    x = simulate(target, DECADES, np.full(DECADES.size, 90.0)).displacement
    early, late = (at(DECADES, x, 10.0 * since) - at(DECADES, x, since) for since in (0.3, 3.0))
    assert late / early == pytest.approx(10.0 ** -0.1, rel=0.03)


def test_a_mount_relaxes_by_the_modified_power_law():
    branches = {}

    class Recorder:
        reference = SimpleNamespace(stiffness=1e7)

        def add_state(self, name, rates):
            branches[name] = [1.0 / rates['displacement'], 0.0]

        def add_force(self, gains):
            name, = gains.keys() - {'displacement'}
            branches[name][1] = gains[name]

    power, onset, since = 0.12, 2e-3, 0.1
    EFFECTS['mount_creep'].apply(Recorder(), 0.02, power, onset, since)
    times, stiffness = np.array(list(branches.values())).T
    t = np.geomspace(onset / 10.0, 5.0, 40)
    yielded = stiffness @ np.exp(-np.outer(1.0 / times, t))
    # Williams 1964: the spectrum tau^-n exp(-onset/tau) adds up to Gamma(n) (onset + t)^-n.
    whole = 2e5 / math.log(10.0) * math.gamma(power) * ((onset + t) / since) ** -power
    assert np.diff(yielded) == pytest.approx(np.diff(whole), rel=0.025)
