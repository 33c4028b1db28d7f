# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""When two effects are believed in, and which two, from what they explain and leave."""

from dataclasses import replace

from piezo_stack_sim.gap.deciding.ranked import DEFAULTS, Ranked
from piezo_stack_sim.gap.deciding.second import rivals_beside_mended, rivals_of
from piezo_stack_sim.gap.deciding.verdict import Cut, decide, tie_pairs
import pytest


@pytest.mark.parametrize('removed, excess, word', [
    (0.99, 0.3, 'MULTIPLE'), (0.02, 5e5, 'UNKNOWN'), (0.02, 0.05, 'MULTIPLE')])
def test_two_effects_that_leave_most_of_a_gap_are_none(removed, excess, word):
    singles = [Ranked('sensor_nonlinearity', 17.0, 0.02, 2, 0.74, 5e5),
               Ranked('parallel_stiffness', 5.0, -0.1, 1, 1.0, 5e5)]
    pair = Ranked('parallel_stiffness+sensor_nonlinearity', 90.0, removed, 3, 0.3, excess,
                  second=61.0, part=0.97, over=25.0)
    assert decide(singles, [pair], 0.99, 5e5, []).word == word


@pytest.mark.parametrize('second, part, removed, left, word', [
    (300.0, 0.8, 0.99, 0.02, 'MULTIPLE'),
    (10.0, 0.8, 0.99, 0.02, 'CAUSE'),  # too little to tell
    (300.0, 0.1, 0.99, 0.02, 'CAUSE'),  # most of what it acts on stays
    (300.0, 0.8, 0.82, 0.15, 'CAUSE'),  # in some cells it helps, all in all it does not
    (300.0, 0.8, 0.82, 0.02, 'MULTIPLE'),  # in most recordings it does
    (300.0, 0.8, 0.99, 0.15, 'MULTIPLE')])  # where the gap is large it does
def test_a_second_effect_counts_only_if_it_explains_what_the_first_leaves(
        second, part, removed, left, word):
    singles = [Ranked('leakage', 300.0, 0.80, 1, 0.2), Ranked('friction', 50.0, 0.1, 1, 0.9)]
    pairs = [Ranked('leakage+friction', 500.0, removed, 2, left, second=second, part=part)]
    assert decide(singles, pairs, 0.8, 50.0, []).word == word


@pytest.mark.parametrize('gain, word', [(2000.0, 'MULTIPLE'), (20000.0, 'CAUSE')])
def test_a_second_effect_explains_more_than_the_form_of_a_strong_first_misses(gain, word):
    singles = [Ranked('leakage', gain, 0.98, 1, 0.02), Ranked('friction', 50.0, 0.1, 1, 0.9)]
    pairs = [Ranked('leakage+friction', gain + 200.0, 0.999, 2, 0.001, second=200.0, part=0.8)]
    assert decide(singles, pairs, 0.99, 50.0, []).word == word


def test_of_two_effects_the_stronger_is_named_first():
    singles = [Ranked('sensor_delay', 300.0, 0.80, 1, 0.2), Ranked('friction', 50.0, 0.1, 1, 0.9)]
    pairs = [Ranked('friction+sensor_delay', 500.0, 0.99, 2, 0.01, second=300.0, part=0.8)]
    assert decide(singles, pairs, 0.99, 50.0, []).selected == ('sensor_delay', 'friction')


def test_two_effects_that_explain_no_more_than_a_third_alone_are_not_believed():
    singles = [Ranked('amplifier_bandwidth', 900.0, 0.99, 2, 0.03),
               Ranked('command_delay', 500.0, 0.9, 1, 0.2)]
    pair = Ranked('command_delay+friction', 800.0, 0.97, 3, 0.01, second=300.0, part=0.8,
                  over=-50.0)
    assert decide(singles, [pair], 0.99, 50.0, []).selected == ('amplifier_bandwidth',)


@pytest.mark.parametrize('removed, excess, kin, word', [
    (0.99, 18.5, True, 'CAUSE'),
    (0.99, 18.5, False, 'MULTIPLE'),  # nothing in it resembles the one
    (0.99, 2.0, True, 'MULTIPLE'),  # the one leaves a recording loud, the two do not
    (0.65, 18.5, True, 'MULTIPLE')])  # the one leaves much
def test_a_relative_whose_form_another_mends_does_not_take_the_place_of_a_cause(
        removed, excess, kin, word):
    singles = [Ranked('sensor_nonlinearity', 425.0, removed, 2, 0.01, 10.0),
               Ranked('transducer_nonlinearity', 300.0, 0.6, 2, 0.2, 50.0)]
    pair = Ranked('transducer_nonlinearity+series_compliance', 460.0, 0.9975, 3, 0.005, excess,
                  second=126.0, part=0.65, over=99.0, form=170.0, wrong=0.03)
    resembling = {frozenset(('sensor_nonlinearity', 'transducer_nonlinearity'))} if kin else set()
    verdict = decide(singles, [pair], 0.999, 1e3, [], kin=resembling)
    assert verdict.word == word


def test_a_relative_that_fills_in_what_the_form_of_a_cause_misses_is_no_second_cause():
    singles = [Ranked('thermal_drift', 900.0, 0.98, 2, 0.1),
               Ranked('sensor_drift', 500.0, 0.7, 1, 0.4)]
    relative = Ranked('thermal_drift+sensor_drift', 950.0, 0.995, 3, 0.01, second=200.0, part=0.5)
    kin = {frozenset(('thermal_drift', 'sensor_drift'))}
    assert decide(singles, [relative], 0.99, 50.0, [], kin=kin).selected == ('thermal_drift',)
    assert decide(singles, [relative], 0.99, 50.0, []).word == 'MULTIPLE'
    # Nor is another that explains less of the same; one that explains more is.
    for second, word in ((150.0, 'CAUSE'), (250.0, 'MULTIPLE')):
        other = Ranked('mount_creep+thermal_drift', 940.0, 0.99, 3, 0.02, second=second, part=0.5)
        assert decide(singles, [relative, other], 0.99, 50.0, [], kin=kin).word == word
    # One that leaves far less than the relative, all in all, is another matter.
    poor = replace(relative, left=0.08)
    assert decide(singles, [poor, other], 0.99, 50.0, [], kin=kin).word == 'MULTIPLE'
    # So is one that leaves the loudest recording far quieter.
    loud = replace(relative, excess=2.0)
    for excess, word in ((0.3, 'MULTIPLE'), (1.5, 'CAUSE')):
        quiet = replace(other, second=150.0, excess=excess)
        assert decide(singles, [loud, quiet], 0.99, 50.0, [], kin=kin).word == word


def test_a_relative_counts_where_one_leaves_more_than_twice_what_both_do():
    singles = [Ranked('contact', 170.0, 0.78, 2, 0.26),
               Ranked('asymmetric_hysteresis', 169.0, 0.67, 1, 0.26)]
    pair = Ranked('asymmetric_hysteresis+contact', 240.0, 0.93, 3, 0.07, second=180.0, part=0.36,
                  over=220.0, form=360.0)
    kin = {frozenset(('asymmetric_hysteresis', 'contact'))}

    def word(pair, best=singles[0]):
        return decide([best, singles[1]], [pair], 0.87, 39.0, [], kin=kin).word

    assert word(pair) == word(replace(pair, form=160.0)) == 'MULTIPLE'
    # Not if an error of form could be it, if much is left, or if one explains nearly all.
    assert word(replace(pair, form=100.0)) != 'MULTIPLE'
    assert word(replace(pair, removed=0.86)) != 'MULTIPLE'
    assert word(replace(pair, left=0.2)) != 'MULTIPLE'
    assert word(replace(pair, removed=0.99), replace(singles[0], removed=0.9)) != 'MULTIPLE'


@pytest.mark.parametrize('removed, excess, best_excess, word', [
    (0.982, 0.29, 0.71, 'MULTIPLE'),
    (0.982, 0.60, 0.71, 'CAUSE'),  # the loudest recording is as loud as it was
    (0.990, 0.08, 0.23, 'CAUSE')])  # hardly anything was left: a form is no better
def test_a_slow_second_effect_needs_few_rows_where_it_quietens_the_loudest(
        removed, excess, best_excess, word):
    singles = [Ranked('parallel_stiffness', 2874.0, 0.968, 2, 0.05, best_excess),
               Ranked('amplifier_gain', 2690.0, 0.92, 1, 0.08, 2.5)]
    pair = Ranked('parallel_stiffness+sensor_drift', 2886.0, removed, 3, 0.048, excess,
                  second=28.5, part=0.43, over=33.6, form=48.4)
    assert decide(singles, [pair], 0.55, 16.5, []).word == word


@pytest.mark.parametrize('alone, together, word', [
    (0.60, 0.99, 'MULTIPLE'),  # hardly anything is left: no form misses so much
    (0.60, 0.85, 'CAUSE'),  # what the form of the first misses may be what the second fills in
    (0.97, 0.999, 'CAUSE')])
def test_two_that_leave_hardly_anything_of_much_need_less_to_be_believed(alone, together, word):
    singles = [Ranked('leakage', 5000.0, alone, 1, 0.4), Ranked('friction', 50.0, 0.1, 1, 0.9)]
    pair = Ranked('leakage+friction', 5200.0, together, 2, 0.1, second=100.0, part=0.8, over=100.0)
    assert decide(singles, [pair], 0.6, 50.0, []).word == word


@pytest.fixture
def stop_and_delay():
    """Return single effects and pairs, of which the first would be answered."""
    singles = [Ranked('contact', 900.0, 0.9, 2, 0.2), Ranked('sensor_delay', 100.0, 0.1, 1, 0.9)]

    def pair(name, over, removed=0.995):
        return Ranked(name, 1000.0, removed, 3, 0.01, second=300.0, part=0.8, over=over)

    return singles, pair


def test_two_effects_of_which_one_may_be_exchanged_are_told_as_a_tie(stop_and_delay):
    singles, pair = stop_and_delay
    pairs = [pair('contact+sensor_delay', 600.0), pair('contact+sensor_lag', 560.0),
             pair('friction+sensor_delay', 200.0)]
    verdict = tie_pairs(decide(singles, pairs, 0.99, 50.0, []), pairs, singles)
    assert verdict.word == 'MULTIPLE' and verdict.selected == ('contact', 'sensor_delay')
    assert verdict.tie == ('sensor_delay', 'sensor_lag')
    assert 'sensor lag' in verdict.reason
    chance = verdict.pairs
    assert set(chance) == {'contact+sensor_delay', 'contact+sensor_lag'}
    assert sum(chance.values()) == pytest.approx(verdict.confidence)
    assert chance['contact+sensor_lag'] < chance['contact+sensor_delay']


def test_a_pair_found_late_that_does_better_takes_the_place_of_the_first(stop_and_delay):
    singles, pair = stop_and_delay
    pairs = [pair('contact+sensor_delay', 300.0)]
    verdict = decide(singles, pairs, 0.99, 50.0, [])
    better = tie_pairs(verdict, [*pairs, pair('contact+sensor_lag', 600.0)], singles)
    assert better.selected == ('contact', 'sensor_lag') and not better.tie
    assert 'sensor lag' in better.reason
    # Not one that predicts more rows but leaves much more of the gap.
    poor = tie_pairs(verdict, [*pairs, pair('contact+sensor_lag', 600.0, 0.93)], singles)
    assert poor.selected == ('contact', 'sensor_delay') and not poor.tie


def test_two_that_leave_all_quiet_come_before_what_the_measured_voltage_tells():
    singles = [Ranked('amplifier_bandwidth', 900.0, 0.5, 2, 0.3, 1400.0),
               Ranked('sensor_gain', 500.0, 0.49, 1, 0.7, 680.0)]
    known = Ranked('amplifier_bandwidth+sensor_gain', 2000.0, 0.992, 3, 0.01, 11.0, second=300.0,
                   part=0.9, over=900.0)
    quiet = Ranked('amplifier_current_limit+transducer_ratio', 2400.0, 0.9994, 6, 0.001, 0.4,
                   second=900.0, part=0.9, over=1900.0)
    cut = Cut(True, known.name, 0.999, chances={known.name: 0.8, quiet.name: 0.05})
    verdict = decide(singles, [known], 0.99, 50.0, [], cut=cut)
    assert set(verdict.selected) == set(known.name.split('+'))
    better = tie_pairs(verdict, [known, quiet], singles, cut=cut)
    assert set(better.selected) == set(quiet.name.split('+')) and not better.tie
    # Where neither does, no form of a driver misleads what is driven by the voltage.
    loud = tie_pairs(verdict, [known, replace(quiet, excess=6.0)], singles, cut=cut)
    assert set(loud.selected) == set(known.name.split('+'))


def test_a_pair_that_nobody_would_believe_takes_no_place(stop_and_delay):
    singles, pair = stop_and_delay
    first = replace(singles[0], removed=0.95)
    believed = pair('contact+sensor_delay', 300.0)
    # It leaves as little and predicts as many rows, but its second explains nothing.
    idle = replace(pair('contact+sensor_lag', 600.0), second=3.0, part=0.02)
    formed = replace(idle, name='contact+creep', form=400.0, wrong=0.1)
    clear = replace(idle, name='contact+leakage', clear=90.0, clear_part=0.6)
    every = [idle, believed, formed, clear]

    def names(name, pairs):
        return {pair.name for pair in rivals_of(name, first, pairs, DEFAULTS, ())}

    assert names(believed.name, every) == {believed.name, formed.name, clear.name}
    # A relative of the first is what its form leaves out.
    kin = {frozenset(('contact', 'creep'))}
    assert formed not in rivals_of(believed.name, first, every, DEFAULTS, kin)
    # What shows only where the first hardly acts stands for nothing that shows elsewhere.
    assert rivals_of(clear.name, first, [clear, believed], DEFAULTS, ()) == [clear]


@pytest.mark.parametrize('one, two, word', [
    (False, False, 'MULTIPLE'), (False, True, 'CAUSE'), (True, True, 'MULTIPLE')])
def test_what_counts_by_its_form_alone_is_not_at_a_bound(one, two, word):
    """A resonance as broad as there is any bends to what the form of a current limit misses."""
    singles = [Ranked('amplifier_current_limit', 5000.0, 0.979, 4, 0.02, 40.0, stuck=one),
               Ranked('amplifier_bandwidth', 900.0, 0.7, 2, 0.3, 900.0)]
    pair = Ranked('amplifier_current_limit+mechanical_resonance', 5090.0, 0.978, 7, 0.019, 39.0,
                  second=90.0, part=0.15, over=100.0, form=400.0, wrong=0.1, stuck=two)
    assert decide(singles, [pair], 0.999, 2e3, []).word == word


@pytest.mark.parametrize('stuck, clear_part, word', [
    (False, 0.41, 'MULTIPLE'), (True, 0.41, 'CAUSE'), (True, 0.6, 'MULTIPLE')])
def test_what_comes_to_a_bound_counts_only_if_it_is_most_of_the_rest_elsewhere(
        stuck, clear_part, word):
    """A curve of the transducer that is not the library's drives its slope to the end."""
    singles = [Ranked('transducer_nonlinearity', 5000.0, 0.98, 4, 0.02, 4.8),
               Ranked('sensor_nonlinearity', 900.0, 0.7, 2, 0.3, 900.0)]
    pair = Ranked('transducer_nonlinearity+transducer_ratio', 5300.0, 0.999, 5, 0.001, 0.3,
                  second=158.0, part=0.46, over=160.0, form=420.0, wrong=0.1,
                  clear=49.0, clear_part=clear_part, stuck=stuck)
    assert decide(singles, [pair], 0.999, 2e3, []).word == word


def test_what_resembles_a_believed_second_and_does_as_well_is_left_open(stop_and_delay):
    singles, pair = stop_and_delay
    believed = replace(pair('contact+thermal_drift', 700.0), part=0.46)
    twin = replace(believed, name='contact+sensor_drift', part=0.2, second=39.0)
    kin = {frozenset(('thermal_drift', 'sensor_drift'))}
    assert rivals_of(believed.name, singles[0], [believed, twin], DEFAULTS, ()) == [believed]
    assert rivals_of(believed.name, singles[0], [believed, twin], DEFAULTS, kin) == [
        believed, twin]
    worse = replace(twin, gain=twin.gain - 3.0)
    assert worse not in rivals_of(believed.name, singles[0], [believed, worse], DEFAULTS, kin)
    # It may leave more of the gap, by errors of form, only where it does better by all else.
    bent = replace(twin, gain=twin.gain + 2.0,
                   removed=1.0 - 3.0 * (1.0 - believed.removed))
    assert bent not in rivals_of(believed.name, singles[0], [believed, bent], DEFAULTS, kin)
    bent = replace(bent, over=believed.over + 1.0, second=believed.second + 1.0, part=0.5,
                   form=400.0, left=0.5 * believed.left)
    known = replace(believed, form=300.0)
    assert bent in rivals_of(known.name, singles[0], [known, bent], DEFAULTS, kin)


@pytest.mark.parametrize('hardening, word', [(660.0, 'CAUSE'), (460.0, 'MULTIPLE')])
def test_of_what_a_form_is_known_to_miss_another_is_no_second_cause_either(hardening, word):
    """A spring that stiffens as it is bent is no spring and a stop that is met now and then."""
    singles = [Ranked('parallel_stiffness', 3000.0, 0.9993, 1, 0.003, 59.0),
               Ranked('contact', 100.0, 0.3, 2, 0.8, 500.0)]
    pairs = [Ranked('parallel_stiffness+contact', 3100.0, 0.99996, 3, 0.0009, 0.4, second=470.0,
                    part=0.8, over=500.0, form=104.0, wrong=0.02),
             Ranked('parallel_stiffness+stiffness_hardening', 3100.0, 0.99998, 3, 0.0007, 0.4,
                    second=hardening, part=0.79, over=710.0, form=390.0, wrong=0.02)]
    kin = {frozenset(pair.name.split('+')) for pair in pairs}
    assert decide(singles, pairs, 0.999, 900.0, [], kin=kin).word == word


def test_of_two_effects_a_second_that_shows_no_end_is_the_one_that_has_none(stop_and_delay):
    singles, pair = stop_and_delay
    pairs = [replace(pair('contact+thermal_drift', 700.0), simpler='contact+sensor_drift',
                     parameters=4), pair('contact+sensor_drift', 620.0)]
    verdict = tie_pairs(decide(singles, pairs, 0.99, 50.0, []), pairs, singles)
    assert verdict.tie == ('sensor_drift', 'thermal_drift')
    pairs[0] = replace(pairs[0], simpler='')
    verdict = tie_pairs(decide(singles, pairs, 0.99, 50.0, []), pairs, singles)
    assert verdict.selected == ('contact', 'thermal_drift')


def test_pairs_that_do_as_well_where_they_act_are_told_by_all_rows(stop_and_delay):
    singles, pair = stop_and_delay
    near = replace(pair('contact+sensor_delay', 605.0), gain=960.0)
    pairs = [near, pair('contact+sensor_lag', 600.0)]
    verdict = tie_pairs(decide(singles, pairs, 0.99, 50.0, []), pairs, singles)
    assert verdict.tie == ('sensor_lag', 'sensor_delay')


@pytest.mark.parametrize('numbers, word', [
    # Only noise is left where one of them leaves 60 times its power.
    ({'excess': 0.05, 'removed': 0.9995}, 'MULTIPLE'),
    ({'excess': 2.0, 'removed': 0.9995}, 'CAUSE'),
    ({'excess': 0.05, 'removed': 0.99}, 'CAUSE'),
    # Or less than a hundredth of that power, if it explains most of what it touches.
    ({'excess': 0.5, 'removed': 0.9995, 'part': 0.7}, 'MULTIPLE'),
    ({'excess': 0.7, 'removed': 0.9995, 'part': 0.7}, 'CAUSE'),
    ({'excess': 0.5, 'removed': 0.9995}, 'CAUSE'),
    # Or it shows where the first hardly acts.
    ({'clear': 200.0, 'clear_part': 0.7}, 'MULTIPLE'),
    ({'clear': 200.0, 'clear_part': 0.6}, 'CAUSE'),
    ({'clear': 140.0, 'clear_part': 0.7}, 'CAUSE'),
    # The form of the first would do as well, or that of the second is wrong.
    ({'clear': 200.0, 'clear_part': 0.7, 'form': 200.0}, 'CAUSE'),
    ({'clear': 200.0, 'clear_part': 0.7, 'wrong': 0.4}, 'CAUSE')])
def test_relatives_are_both_needed_where_neither_fills_in_for_the_other(numbers, word):
    singles = [Ranked('creep', 300.0, 0.97, 2, 0.03, 60.0),
               Ranked('mount_creep', 200.0, 0.9, 2, 0.2, 90.0)]
    pair = replace(Ranked('creep+mount_creep', 350.0, 0.99, 4, 0.01, 5.0, second=450.0, part=0.45,
                          over=450.0, form=900.0, wrong=0.1), **numbers)
    kin = {frozenset(('creep', 'mount_creep'))}
    verdict = decide(singles, [pair], 0.97, 800.0, [], kin=kin)
    assert verdict.word == word
    if word == 'MULTIPLE':
        assert rivals_of(pair.name, singles[0], [pair], DEFAULTS, kin) == [pair]
    if 'removed' in numbers and word == 'MULTIPLE':
        assert 'removes 97 %' in verdict.reason and '99.95 %' in verdict.reason


@pytest.mark.parametrize('numbers, word', [
    ({}, 'MULTIPLE'),
    ({'excess': 0.45}, 'CAUSE'),  # more than a tenth of what stood out is left
    ({'part': 0.7}, 'CAUSE'),  # where it acts, the first would leave less
    ({'second': 35.0}, 'CAUSE'),
    ({'over': 75.0}, 'CAUSE'),
    ({'form': 30.0}, 'CAUSE'),  # an error of the form of the first would do as well
    ({'wrong': 0.4}, 'CAUSE')])
def test_a_relative_that_leaves_the_noise_of_what_stood_out_needs_fewer_nats(numbers, word):
    singles = [Ranked('parallel_stiffness', 720.0, 0.978, 1, 0.166, 3.7),
               Ranked('leakage', 100.0, 0.6, 1, 0.7, 660.0)]
    pair = replace(Ranked('initial_polarisation+parallel_stiffness', 730.0, 0.982, 4, 0.165, 0.23,
                          second=87.0, part=0.82, over=156.0, form=135.0, wrong=0.02), **numbers)
    kin = {frozenset(('initial_polarisation', 'parallel_stiffness'))}
    assert decide(singles, [pair], 0.977, 2600.0, [], kin=kin).word == word


@pytest.mark.parametrize('numbers, word', [
    ({}, 'MULTIPLE'),
    ({'excess': 3.5}, 'CAUSE'),  # more than a tenth of what stood out is left
    ({'removed': 0.9995}, 'CAUSE'),  # and that is no noise, nor little of the gap
    ({'removed': 0.9995, 'excess': 0.45}, 'MULTIPLE'),
    ({'part': 0.7}, 'CAUSE')])
def test_nor_need_one_that_leaves_hardly_anything_of_the_gap(numbers, word):
    singles = [Ranked('amplifier_saturation', 720.0, 0.9973, 2, 0.01, 28.3),
               Ranked('leakage', 100.0, 0.6, 1, 0.7, 660.0)]
    pair = replace(Ranked('amplifier_saturation+initial_polarisation', 760.0, 0.99984, 5, 0.001,
                          0.81, second=158.0, part=0.79, over=174.0, form=151.0, wrong=0.02),
                   **numbers)
    kin = {frozenset(('amplifier_saturation', 'initial_polarisation'))}
    assert decide(singles, [pair], 0.99, 2600.0, [], kin=kin).word == word


@pytest.mark.parametrize('numbers, word', [
    ({}, 'MULTIPLE'),
    ({'removed': 0.995}, 'CAUSE'),  # more than a twentieth of the gap that one leaves
    ({'part': 0.35}, 'CAUSE'),
    ({'form': 900.0}, 'CAUSE'),  # errors of form might do as well
    ({'over': 450.0}, 'CAUSE'),
    ({'wrong': 0.4}, 'CAUSE')])
def test_a_relative_that_leaves_a_twentieth_of_the_gap_need_not_reach_the_noise(numbers, word):
    singles = [Ranked('initial_polarisation', 124.0, 0.919, 8, 0.074, 895.0),
               Ranked('leakage', 80.0, 0.6, 1, 0.24, 9400.0)]
    pair = replace(Ranked('initial_polarisation+stiffness_hardening', 193.0, 0.9988, 10, 0.001,
                          27.0, second=583.0, part=0.48, over=658.0, form=2044.0, wrong=0.02),
                   **numbers)
    kin = {frozenset(('initial_polarisation', 'stiffness_hardening'))}
    assert decide(singles, [pair], 0.84, 5e4, [], kin=kin).word == word


@pytest.mark.parametrize('numbers, word', [
    ({}, 'MULTIPLE'), ({'clear': 0.0, 'clear_part': 0.0}, 'CAUSE'), ({'clear_part': 0.3}, 'CAUSE'),
    ({'form': 200.0}, 'CAUSE'), ({'second': 200.0}, 'CAUSE')])
def test_what_fills_in_the_form_of_the_first_counts_where_that_hardly_acts(numbers, word):
    """Friction that depends on the speed shows where it rubs, a slow ceramic everywhere."""
    singles = [Ranked('friction', 600.0, 0.942, 2, 0.097, 89.7),
               Ranked('creep', 200.0, 0.25, 4, 0.7, 900.0)]
    pair = replace(Ranked('friction+rate_dependent_hysteresis', 652.0, 0.973, 6, 0.028, 45.7,
                          second=637.0, part=0.26, over=789.0, form=973.0, wrong=0.17,
                          clear=161.0, clear_part=0.5), **numbers)
    assert decide(singles, [pair], 0.83, 977.0, []).word == word


@pytest.mark.parametrize('alone, numbers, word', [
    (0.923, {}, 'MULTIPLE'),
    (0.955, {}, 'CAUSE'),  # a form may miss so much
    (0.923, {'removed': 0.9972}, 'CAUSE'),  # and what fills it in, leave so little
    (0.923, {'excess': 8.0}, 'CAUSE'),
    (0.923, {'part': 0.7}, 'CAUSE'),
    (0.923, {'form': 200.0}, 'CAUSE'),
    (0.923, {'wrong': 0.1}, 'CAUSE'),
    (0.923, {'clear': 120.0}, 'CAUSE')])
def test_what_fills_in_the_form_of_the_first_counts_where_no_form_misses_so_much(
        alone, numbers, word):
    singles = [Ranked('transducer_ratio', 3242.0, alone, 2, 0.046, 140.6),
               Ranked('leakage', 100.0, 0.3, 1, 0.9, 660.0)]
    pair = replace(Ranked('transducer_ratio+series_compliance', 3321.0, 0.9991, 4, 0.031, 0.19,
                          second=183.0, part=0.83, clear=159.0, clear_part=0.82, over=192.0,
                          form=636.0, wrong=0.02), **numbers)
    assert decide(singles, [pair], 0.99, 2600.0, []).word == word


@pytest.mark.parametrize('alone, together, word', [
    (3.5, 0.6, 'MULTIPLE'), (3.5, 1.7, 'CAUSE'), (0.4, 0.1, 'CAUSE')])
def test_a_second_effect_counts_that_quietens_the_loudest_recording(alone, together, word):
    # Of the rest, noise that no effect takes away, the two leave as much as one.
    singles = [Ranked('initial_polarisation', 250.0, 0.9695, 5, 0.38, alone),
               Ranked('leakage', 23.0, 0.2, 1, 0.9, 670.0)]
    pair = Ranked('initial_polarisation+thermal_drift', 275.0, 0.9757, 7, 0.354, together,
                  second=92.0, part=0.36, over=124.0, form=240.0, wrong=0.34)
    assert decide(singles, [pair], 0.84, 700.0, []).word == word


def test_what_an_effect_says_its_form_leaves_out_is_no_second_of_its_kind():
    singles = [Ranked('transducer_ratio', 5000.0, 0.999, 1, 0.006, 9.0),
               Ranked('series_compliance', 4400.0, 0.97, 1, 0.03, 1000.0)]
    pair = Ranked('transducer_ratio+series_compliance', 5100.0, 0.99998, 2, 0.001, 0.08,
                  second=307.0, part=0.5, over=480.0, form=550.0, wrong=0.02)
    kin = {frozenset(('transducer_ratio', 'series_compliance'))}
    assert decide(singles, [pair], 0.998, 2e5, [], kin=kin).word == 'CAUSE'


def test_pairs_tie_by_what_resembles_one_of_the_two(stop_and_delay):
    singles, pair = stop_and_delay
    pairs = [pair('contact+sensor_delay', 700.0), pair('contact+command_delay', 300.0)]
    verdict = decide(singles, pairs, 0.99, 50.0, [])
    assert not tie_pairs(verdict, pairs, singles).tie
    alike = [['command_delay', 'sensor_delay']]
    tied = tie_pairs(verdict, pairs, singles, classes=alike)
    assert tied.tie == ('sensor_delay', 'command_delay')
    assert tied.selected == ('contact', 'sensor_delay')
    # Not with what leaves far more, nor with what looks like neither of them.
    worse = [pairs[0], replace(pairs[1], removed=0.9)]
    assert not tie_pairs(verdict, worse, singles, classes=alike).tie
    assert not tie_pairs(verdict, pairs, singles, classes=[['command_delay', 'contact']]).tie


def test_behind_the_terminals_the_form_of_a_driver_does_not_mislead():
    singles = [Ranked('contact', 400.0, 0.79, 2, 0.3),
               Ranked('amplifier_gain', 300.0, 0.6, 2, 0.5)]
    stop, bow = (Ranked(f'amplifier_gain+{name}', gain, 0.994, 4, 0.08, second=500.0, part=0.4,
                        over=over) for name, gain, over in (
                            ('contact', 700.0, 900.0), ('stiffness_hardening', 650.0, 1900.0)))
    cut = Cut(True, stop.name, 0.99, chances={stop.name: 0.75, bow.name: 0.25})
    verdict = decide(singles, [bow, stop], 0.99, 3e4, [], cut=cut)
    told = tie_pairs(verdict, [bow, stop], singles, cut=cut)
    assert told.selected == ('contact', 'amplifier_gain')
    assert told.tie == ('contact', 'stiffness_hardening')
    assert told.pairs[stop.name] == pytest.approx(3.0 * told.pairs[bow.name])
    # Where it is not clear what lies behind them, the whole chain tells.
    vague = replace(cut, removed=0.6)
    verdict = tie_pairs(decide(singles, [stop, bow], 0.99, 3e4, [], cut=vague), [bow, stop],
                        singles, cut=vague)
    assert set(verdict.selected) == {'amplifier_gain', 'stiffness_hardening'}


def test_a_second_effect_counts_past_the_form_of_the_first():
    lag, other = Ranked('sensor_lag', 8000.0, 0.985, 1, 0.1), Ranked('creep', 10.0, 0.0, 1)
    form = Ranked('sensor_lag+sensor_delay', 9000.0, 0.994, 2, 0.05)
    pair = Ranked('creep+sensor_lag', 9100.0, 0.999, 3, 0.01, second=150.0, part=0.7, over=160.0,
                  beside=form)

    def said(kin=(), **changes):
        return decide([lag, other], [replace(pair, **changes)], 0.99, 50.0, [], kin=kin).word

    assert said() == 'MULTIPLE'
    assert ('leaves together with sensor delay, which only mends its form, creep explains 70 %'
            in decide([lag, other], [pair], 0.99, 50.0, []).reason)
    # Without what mends the form of the lag so little is what that form misses.
    assert said(beside=None) == 'CAUSE'
    assert said(part=0.3) == said(second=60.0) == said(left=0.045, removed=0.995) == 'CAUSE'
    assert said([frozenset(('creep', 'sensor_delay'))]) == 'CAUSE'
    # What leaves less than a tenth of it need explain less of where it acts.
    assert said(part=0.3, removed=0.9995) == 'MULTIPLE'
    assert said(part=0.2, removed=0.9995) == 'CAUSE'


def test_beside_a_mended_first_pairs_are_told_by_what_the_second_does_there():
    form = Ranked('transducer_ratio+sensor_gain', 540.0, 0.9992, 2, 0.01)
    warm, drift = (Ranked(name, 520.0, 0.996, 3, over=over) for name, over in (
        ('transducer_ratio+thermal_drift', -69.0), ('transducer_ratio+sensor_drift', 90.0)))
    hidden = [replace(warm, gain=547.0, removed=0.9999, over=170.0, second=166.0, part=0.6,
                      left=0.001, beside=form),
              replace(drift, gain=546.0, removed=0.9998, over=62.0, second=61.0, part=0.6,
                      left=0.001, beside=form)]
    lag = replace(warm, name='sensor_gain+thermal_drift', over=-80.0)
    best = Ranked('transducer_ratio', 510.0, 0.9964, 1, 0.01)
    # Softer under a load is what its form leaves: nobody's second.
    soft = replace(hidden[0], name='transducer_ratio+series_compliance')
    weak = replace(hidden[1], name='transducer_ratio+friction', second=20.0)
    rivals = {pair.name: pair for pair in rivals_beside_mended(
        warm.name, best, [warm, drift, lag], [*hidden, soft, weak], DEFAULTS, ())}
    assert set(rivals) == {warm.name, drift.name, lag.name}
    assert rivals[warm.name] is warm and rivals[lag.name] is lag
    assert rivals[warm.name].over - rivals[drift.name].over == pytest.approx(108.0)
    assert rivals[warm.name].removed - rivals[drift.name].removed == pytest.approx(1e-4)

    # And what explains less than that does is in its shade.
    def said(*given):
        return decide([best, Ranked('friction', 0.0, 0.0, 1)], list(given), 0.99, 50.0, []).word

    assert said(hidden[0]) == 'MULTIPLE'
    assert said(hidden[0], replace(soft, second=200.0)) == 'CAUSE'
    # Unless it quietens the recording that the other leaves as loud as before.
    quiet, loud = replace(hidden[0], excess=4.0), replace(soft, second=200.0, excess=90.0)
    assert said(quiet, loud) == 'MULTIPLE'
    assert said(replace(quiet, excess=80.0), loud) == 'CAUSE'


def test_where_cells_tell_nothing_all_rows_tell_which_pair_it_is(stop_and_delay):
    singles, pair = stop_and_delay
    chosen = replace(pair('contact+sensor_lag', 605.0), gain=960.0)
    other = replace(pair('contact+sensor_delay', 600.0), gain=950.0)
    believed = decide(singles, [chosen, other], 0.99, 50.0, [])
    # None better than one effect alone, by hundreds of nats: some cells of the first drown it.
    drowned = [replace(chosen, over=-649.0), replace(other, over=-384.0)]
    verdict = tie_pairs(believed, drowned, singles)
    assert verdict.tie == ('sensor_lag', 'sensor_delay')


def test_two_that_leave_hardly_anything_need_not_explain_it_all_where_the_second_acts():
    best, other = Ranked('added_mass', 5000.0, 0.4, 1, 0.6), Ranked('sensor_gain', 300.0, 0.3, 1)
    pair = Ranked('added_mass+sensor_gain', 6500.0, 0.98, 2, 0.2, second=600.0, part=0.12,
                  over=1400.0)
    assert decide([best, other], [pair], 0.99, 50.0, []).word == 'MULTIPLE'
    more = replace(pair, removed=0.9)
    assert decide([best, other], [more], 0.99, 50.0, []).word == 'UNKNOWN'


@pytest.mark.parametrize('clear, part, over, first, word', [
    (200.0, 0.6, 250.0, 0.96, 'MULTIPLE'),  # though the first's form leaves as much as before
    (30.0, 0.6, 250.0, 0.96, 'CAUSE'),
    (200.0, 0.2, 250.0, 0.96, 'CAUSE'),
    (200.0, 0.6, 0.0, 0.96, 'CAUSE'),
    (200.0, 0.6, 250.0, 0.8, 'CAUSE')])
def test_a_second_effect_counts_that_shows_where_the_first_hardly_acts(
        clear, part, over, first, word):
    singles = [Ranked('command_delay', 6000.0, first, 1, 0.1), Ranked('friction', 0.0, 0.0, 1)]
    pair = Ranked('command_delay+thermal_drift', 6050.0, first + 0.005, 3, 0.09, second=250.0,
                  part=0.5, over=over, clear=clear, clear_part=part)
    verdict = decide(singles, [pair], 0.8, 20.0, [])
    assert verdict.word == word
    assert ('where it does less than thermal drift, that explains 60 %' in verdict.reason) == (
        word == 'MULTIPLE')
    relatives = {frozenset(('command_delay', 'thermal_drift'))}
    assert decide(singles, [pair], 0.8, 20.0, [], kin=relatives).word == 'CAUSE'
    # What explains less than a relative of the first does only fills in its form, too.
    mending = replace(pair, name='command_delay+friction', gain=6080.0, removed=first + 0.007,
                      second=300.0, part=0.4, clear=0.0, clear_part=0.0)
    relatives = {frozenset(('command_delay', 'friction'))}
    assert decide(singles, [pair, mending], 0.8, 20.0, [], kin=relatives).word == 'CAUSE'


@pytest.mark.parametrize('form, wrong, word', [
    (400.0, 0.1, 'MULTIPLE'),
    (100.0, 0.1, 'CAUSE'),  # an error of form does nearly as well
    (400.0, 0.5, 'CAUSE')])  # the second would itself be half wrong
def test_a_second_effect_counts_that_no_error_of_the_firsts_form_could_be(form, wrong, word):
    # By cells that may hold anything neither counts for much.
    singles = [Ranked('rate_dependent_hysteresis', 600.0, 0.94, 3, 0.1),
               Ranked('thermal_drift', 4.0, 0.06, 2)]
    pair = Ranked('rate_dependent_hysteresis+thermal_drift', 615.0, 0.96, 5, 0.08, second=20.0,
                  part=0.1, over=15.0, form=form, wrong=wrong)
    verdict = decide(singles, [pair], 0.99, 30.0, [])
    assert verdict.word == word
    assert ('an error of its form' in verdict.reason) == (word == 'MULTIPLE')
    # What a relative of the first does is an error of its form; so is what explains no more than
    # that does.
    relatives = {frozenset(pair.name.split('+'))}
    assert decide(singles, [pair], 0.99, 30.0, [], kin=relatives).word == 'CAUSE'
    mending = replace(pair, name='rate_dependent_hysteresis+creep', form=form + 50.0)
    relatives = {frozenset(mending.name.split('+'))}
    assert decide(singles, [pair, mending], 0.99, 30.0, [], kin=relatives).word == 'CAUSE'
    # What leaves more than one alone only bends to the form of that.
    worse = replace(pair, removed=0.92)
    assert decide(singles, [worse], 0.99, 30.0, []).word == 'CAUSE'


@pytest.mark.parametrize('removed, over, word', [
    (0.9995, 140.0, 'MULTIPLE'),
    (0.99, 140.0, 'CAUSE'),  # what is left may be the second's, or the form of the first
    (0.9995, 30.0, 'CAUSE')])  # in too few rows to tell
def test_two_that_leave_next_to_nothing_need_not_show_where_the_second_acts(removed, over, word):
    # A hum is loud wherever a wrong gain is, which the nominal parameters had stood in for.
    singles = [Ranked('periodic_disturbance', 2030.0, 0.94, 3, 0.1),
               Ranked('sensor_gain', 4.0, 0.06, 1)]
    pair = Ranked('periodic_disturbance+sensor_gain', 2115.0, removed, 4, 0.01, second=9.0,
                  part=0.02, over=over)
    verdict = decide(singles, [pair], 0.99, 380.0, [])
    assert verdict.word == word
    # What it explains where it acts is no reason here.
    assert ('of what the first leaves the two leave 1 %' in verdict.reason) == (
        word == 'MULTIPLE')
    relatives = {frozenset(pair.name.split('+'))}
    assert decide(singles, [pair], 0.99, 380.0, [], kin=relatives).word == 'CAUSE'


@pytest.mark.parametrize('removed, word', [(0.9985, 'CAUSE'), (0.9992, 'MULTIPLE')])
def test_two_that_remove_less_than_one_only_bend_to_quiet_rows(removed, word):
    singles = [Ranked('sensor_gain', 114.0, 0.9989, 1, 0.001), Ranked('mount_creep', 5.0, 0.1, 2)]
    pair = Ranked('mount_creep+sensor_gain', 180.0, removed, 3, 0.0004, second=58.0, part=0.64,
                  over=147.0)
    assert decide(singles, [pair], 0.99, 80.0, []).word == word
    # What shows where the first hardly acts bends nothing.
    clear = replace(pair, clear=90.0, clear_part=0.6)
    assert decide(singles, [clear], 0.99, 80.0, []).word == 'MULTIPLE'


def test_what_the_form_of_a_cause_is_known_to_leave_out_is_no_second_cause():
    # A payload on a joint comes late, and the late may be due to a payload; not so a leak.
    def decided(first, second):
        singles = [Ranked(first, 900.0, 0.9, 1, 0.1), Ranked(second, 100.0, 0.1, 1, 0.9)]
        pair = Ranked(f'{first}+{second}', 1200.0, 0.99, 2, 0.01, second=300.0, part=0.5)
        return decide(singles, [pair], 0.99, 20.0, []).word

    assert decided('added_mass', 'command_delay') == 'CAUSE'
    assert decided('command_delay', 'added_mass') == 'MULTIPLE'
    assert decided('added_mass', 'leakage') == 'MULTIPLE'


@pytest.mark.parametrize('kin, word', [
    (('transducer_nonlinearity', 'sensor_gain'), 'CAUSE'),
    (('transducer_nonlinearity',), 'MULTIPLE')])
def test_two_that_both_resemble_the_best_only_mend_its_form(kin, word):
    singles = [Ranked('sensor_nonlinearity', 2657.0, 0.97, 2, 0.031, 7.8),
               Ranked('sensor_gain', 700.0, 0.26, 1, 0.8, 300.0)]
    pair = Ranked('transducer_nonlinearity+sensor_gain', 2748.0, 0.9926, 3, 0.013, 1.5,
                  second=129.0, part=0.37, over=149.0, form=255.0, wrong=0.02)
    related = {frozenset(('sensor_nonlinearity', name)) for name in kin}
    assert decide(singles, [pair], 0.99, 300.0, [], DEFAULTS, related).word == word


@pytest.mark.parametrize('numbers, word', [
    ({}, 'MULTIPLE'), ({'wrong': 0.2}, 'CAUSE'), ({'second': 120.0}, 'CAUSE'),
    ({'part': 0.4}, 'CAUSE'), ({'removed': 0.9997}, 'CAUSE')])
def test_a_relative_counts_that_explains_most_of_the_rest_by_the_very_form_it_has(numbers, word):
    singles = [Ranked('transducer_ratio', 330.0, 0.9996, 1, 0.001, 76.0),
               Ranked('sensor_gain', 200.0, 0.9, 1, 0.3, 900.0)]
    pair = replace(Ranked('transducer_ratio+stiffness_hardening', 335.0, 0.99985, 2, 0.0006, 63.0,
                          second=371.0, part=0.6, over=408.0, form=165.0, wrong=0.02), **numbers)
    kin = {frozenset(('transducer_ratio', 'stiffness_hardening'))}
    assert decide(singles, [pair], 0.9999, 900.0, [], DEFAULTS, kin).word == word


@pytest.mark.parametrize('second, form, word', [
    (95.0, 274.0, 'CAUSE'), (50.0, 100.0, 'MULTIPLE')])
def test_a_second_that_a_relative_nearly_matches_is_an_error_of_form(second, form, word):
    singles = [Ranked('leakage', 453.0, 0.9958, 1, 0.014, 277.0),
               Ranked('creep', 100.0, 0.3, 2, 0.6, 9e3)]
    pair = Ranked('leakage+mount_creep', 468.0, 0.9951, 4, 0.0035, 712.0, second=110.0, part=0.31,
                  over=98.0, form=295.0, wrong=0.17, clear=60.0)
    other = Ranked('creep+leakage', 473.0, 0.9973, 3, 0.0028, 380.0, second=second, part=0.24,
                   over=80.0, form=form, wrong=0.12)
    kin = {frozenset(('leakage', 'creep'))}
    assert decide(singles, [pair, other], 0.999, 9e3, [], DEFAULTS, kin).word == word


@pytest.mark.parametrize('gain, word', [(-630.0, 'UNKNOWN'), (600.0, 'MULTIPLE')])
def test_two_that_predict_worse_than_nothing_are_no_causes(gain, word):
    """A voltage read wrong by a factor: what explains it makes all else wrong."""
    singles = [Ranked('added_mass', 0.0, 0.0, 0, 1.0, 3e5)]
    pair = Ranked('amplifier_gain+parallel_stiffness', gain, 0.9996, 3, 0.0, 1.2e4,
                  second=300.0, part=0.9, over=300.0, form=9e3, wrong=0.02)
    cut = Cut(True, 'amplifier_gain+parallel_stiffness', 0.95)
    for known in (None, cut):
        assert decide(singles, [pair], 0.9999, 3e5, [], DEFAULTS, (), known).word == word


@pytest.mark.parametrize('name, numbers, word', [
    ('command_delay+sensor_lag', {}, 'MULTIPLE'),
    ('command_delay+sensor_lag', {'clear': 100.0}, 'CAUSE'),
    ('command_delay+sensor_lag', {'clear_part': 0.5}, 'CAUSE'),
    ('command_delay+sensor_lag', {'form': 200.0}, 'CAUSE'),
    ('sensor_lag+sensor_delay', {'clear': 0.0, 'clear_part': 0.0}, 'CAUSE')])
def test_what_comes_late_before_a_slow_sensor_counts_where_that_does_not_reach(
        name, numbers, word):
    """A command that comes late moves voltage and charge, too; a filter's second pole does not."""
    singles = [Ranked('sensor_lag', 4900.0, 0.983, 1, 0.06, 33.0),
               Ranked('sensor_delay', 3000.0, 0.91, 1, 0.15, 400.0)]
    pair = replace(Ranked(name, 5690.0, 0.9978, 3, 0.005, 9.2, second=1900.0, part=0.51,
                          over=2200.0, form=3500.0, wrong=0.08, clear=1330.0, clear_part=0.88),
                   **numbers)
    kin = {frozenset(name.split('+'))}
    assert decide(singles, [pair], 0.988, 4700.0, [], DEFAULTS, kin).word == word


@pytest.mark.parametrize('excess, clear, part, word', [
    (5955.0, -3.0, 0.0, 'CAUSE'), (3000.0, -3.0, 0.0, 'MULTIPLE'),
    (1.5e5, 394.0, 0.0, 'MULTIPLE'), (5955.0, 30.0, 0.9, 'MULTIPLE')])
def test_a_second_that_shows_nowhere_else_and_leaves_the_loudest_louder_is_none(
        excess, clear, part, word):
    """A leak that grows with the voltage, which no drift does: but that may fill in a part."""
    singles = [Ranked('leakage', 571.0, 0.9892, 1, 0.0185, 3276.0),
               Ranked('mount_creep', 56.0, -0.09, 4, 0.71, 2.7e5)]
    pair = Ranked('leakage+thermal_drift', 648.0, 0.9922, 3, 0.002, excess, second=137.0,
                  part=0.74, over=138.0, form=305.0, wrong=0.02, clear=clear,
                  clear_part=part)
    assert decide(singles, [pair], 0.96, 4.5e5, []).word == word


@pytest.mark.parametrize('numbers, word', [
    ({}, 'MULTIPLE'), ({'excess': 2.5}, 'CAUSE'), ({'part': 0.45}, 'CAUSE'),
    ({'form': -5.0}, 'CAUSE')])
def test_what_takes_the_loudest_to_a_tenth_needs_no_error_of_form_to_be_ruled_out(numbers, word):
    """A stop of four times the noise beside a wrong transducer, which excuses nearly all."""
    singles = [Ranked('transducer_ratio', 621.0, 0.9999, 2, 0.0007, 22.4),
               Ranked('sensor_gain', 386.0, 0.954, 1, 0.29, 5768.0)]
    pair = replace(Ranked('transducer_ratio+contact', 626.0, 0.99998, 5, 0.0002, 1.54,
                          second=177.0, part=0.72, over=232.0, form=28.0, wrong=0.02), **numbers)
    assert decide(singles, [pair], 0.9999, 9e3, []).word == word
