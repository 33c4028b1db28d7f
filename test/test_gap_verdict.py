# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From scores to words: what is said follows from what hypotheses explain and leave."""

from dataclasses import replace
from types import SimpleNamespace

from piezo_stack_sim.gap.deciding.decision import _simpler, ceiling_of
from piezo_stack_sim.gap.deciding.isolability import Alike
from piezo_stack_sim.gap.deciding.ranked import DEFAULTS, Ranked
from piezo_stack_sim.gap.deciding.verdict import decide, outscored, probabilities, tie_pairs
import pytest


def test_equal_scores_share_the_probability():
    tied = [Ranked('a', 100.0, 0.99, 1), Ranked('b', 100.0, 0.99, 1), Ranked('c', 0.0, 0.0, 1)]
    chance = probabilities(tied)
    assert chance[0] == pytest.approx(chance[1]) and chance[2] < 0.01
    verdict = decide(tied, [], 0.99, 50.0, [])
    assert verdict.word == 'AMBIGUOUS' and set(verdict.tie) == {'a', 'b'}


def test_of_two_that_do_equally_well_the_one_with_less_choice_is_named_first():
    bent, follows = (Ranked('sensor_nonlinearity', 1001.0, 0.999, 2, spent=18.0),
                     Ranked('transducer_nonlinearity', 1000.0, 0.999, 1, spent=13.0))
    none = Ranked('creep', 0.0, 0.0, 3)
    alike = [['transducer_nonlinearity', 'sensor_nonlinearity']]
    verdict = decide([bent, follows, none], [], 0.999, 50.0, alike)
    assert verdict.selected == ('transducer_nonlinearity',)
    assert verdict.tie == ('transducer_nonlinearity', 'sensor_nonlinearity')
    # Who does clearly better is named first all the same.
    better = replace(bent, gain=1040.0)
    assert decide([better, follows, none], [], 0.999, 50.0, alike).selected == (
        'sensor_nonlinearity',)
    # Of two with as many numbers it does not matter how far apart the bounds of these are.
    as_many = replace(follows, parameters=2)
    assert decide([bent, as_many, none], [], 0.999, 50.0, alike).selected == (
        'sensor_nonlinearity',)
    # What withheld rows tell apart they tell, however many numbers it took.
    free = replace(bent, gain=50.0, spent=45.0)
    drift = replace(none, gain=30.0, removed=0.5)
    verdict = decide([free, drift], [], 0.999, 1.0, [])
    assert (verdict.word, verdict.tie) == ('CAUSE', ('sensor_nonlinearity',))


def test_of_two_that_do_equally_well_the_one_with_fewer_numbers_is_named_first():
    stop, spring = Ranked('contact', 1001.0, 0.999, 4), Ranked('parallel_stiffness', 1000.0,
                                                               0.999, 2)
    verdict = decide([stop, spring], [], 0.999, 50.0, [])
    assert verdict.word == 'AMBIGUOUS' and verdict.selected == ('parallel_stiffness',)
    assert verdict.tie == ('parallel_stiffness', 'contact')
    # The better form counts for more than fewer numbers.
    worse = Ranked('parallel_stiffness', 970.0, 0.97, 2)
    assert decide([stop, worse], [], 0.999, 50.0, []).selected == ('contact',)


def test_who_would_go_on_beyond_its_bounds_is_less_likely_than_who_rests_within_them():
    """A stop as soft as none is does as well as a stack that hardens, but is no stop."""
    stop = Ranked('contact', 700.0, 0.98, 3, stuck=True)
    hard = Ranked('stiffness_hardening', 698.0, 0.98, 3)
    far = Ranked('creep', 100.0, 0.2, 1)
    groups = [['contact', 'stiffness_hardening']]
    free = replace(stop, stuck=False)
    odds = [one / other for one, other, _ in (
        probabilities([each, hard, far], classes=groups) for each in (free, stop))]
    assert odds[0] > 1.0 > odds[1] and odds[0] == pytest.approx(10.0 * odds[1])
    assert decide([stop, hard, far], [], 0.99, 50.0, groups).selected == ('stiffness_hardening',)
    # Where nothing else explains the gap it is the cause all the same.
    assert decide([stop, far], [], 0.99, 50.0, []).tie == ('contact',)
    # The same of two that could be exchanged for each other in a pair.
    first, second = (Ranked(f'{name}+sensor_gain', 900.0, 0.999, 4, over=over, second=300.0,
                            part=0.9, form=300.0, stuck=name == 'contact')
                     for name, over in (('contact', 305.0), ('stiffness_hardening', 300.0)))
    verdict = decide([stop, hard, far], [first], 0.99, 50.0, groups)
    assert verdict.word == 'MULTIPLE'
    named = tie_pairs(verdict, [first, second], [stop, hard, far], classes=groups)
    assert 'stiffness_hardening' in named.selected
    trusted = tie_pairs(verdict, [replace(first, stuck=False), second], [stop, hard, far],
                        classes=groups)
    assert 'contact' in trusted.selected


def test_what_recordings_cannot_tell_apart_shares_the_probability():
    one, other, far = (Ranked('a', 700.0, 0.98, 1), Ranked('b', 670.0, 0.96, 1),
                       Ranked('c', 660.0, 0.95, 1))
    assert probabilities([one, other, far])[0] > 0.9
    chance = probabilities([one, other, far], classes=[['a', 'b']])
    assert chance.sum() == pytest.approx(1.0)
    assert 0.2 < chance[1] < chance[0] < 0.8 and chance[2] < 0.1
    # Who leaves far more than the best is told from it, however alike their directions.
    poor = Ranked('b', 400.0, 0.6, 1)
    assert probabilities([one, far, poor], classes=[['a', 'b']])[2] < 0.01


def test_relatives_are_left_open_where_one_channel_was_measured():
    near, far = Ranked('b', 600.0, 0.95, 1), Ranked('b', 400.0, 0.6, 1)
    one, kin = Ranked('a', 700.0, 0.98, 1), {frozenset('ab')}

    def left_open(other, single):
        return decide([one, other], [], 0.99, 50.0, Alike([], [], kin, single).groups).tie

    assert left_open(near, single=True) == ('a', 'b')
    assert left_open(near, single=False) == ('a',)  # the other channels tell them apart
    assert left_open(far, single=True) == ('a',)  # and so does what one leaves
    # Where even the best leaves much, three times that would be everything.
    poor, none = Ranked('a', 700.0, 0.62, 1), Ranked('b', 450.0, 0.08, 1)
    groups = Alike([], [], kin, single=True).groups
    assert decide([poor, none], [], 0.7, 50.0, groups).tie == ('a',)


@pytest.mark.parametrize('second, word', [
    ('stiffness_hardening', 'CAUSE'),  # a flexure that grows stiffer the further it is bent
    ('transducer_ratio', 'MULTIPLE')])
def test_what_the_form_of_a_spring_misses_is_no_second_effect_however_little_it_leaves(
        second, word):
    spring = Ranked('parallel_stiffness', 650.0, 0.999, 1, 0.0001, 400.0)
    other = Ranked(second, 400.0, 0.7, 2, 0.4, 5e5)
    # The two leave nothing but noise.
    pair = Ranked(f'parallel_stiffness+{second}', 655.0, 0.99999, 3, 0.0001, 0.05, 1700.0, 0.8,
                  over=1900.0, form=400.0, wrong=0.02)
    kin = {frozenset(('parallel_stiffness', second))}
    verdict = decide([spring, other], [pair], 0.99, 1e7, [], kin=kin)
    assert (verdict.word, verdict.selected[0]) == (word, 'parallel_stiffness')


@pytest.mark.parametrize('best, structure, word', [
    (Ranked('a', 500.0, 0.99, 1), 20.0, 'CAUSE'),
    (Ranked('a', 15.0, 0.96, 2), 2e4, 'CAUSE'),  # a drift: few rows, but all of the gap
    (Ranked('a', 15.0, 0.80, 2), 2e4, 'UNKNOWN'),
    (Ranked('a', 300.0, 0.0, 3, 0.0), 0.2, 'CAUSE'),  # a gap in one recording, none as a whole
    (Ranked('a', 300.0, 0.0, 3, 0.0, 0.2), 0.2, 'UNKNOWN'),  # of which it leaves all
    (Ranked('a', 800.0, 0.61, 1, 0.67, 3e4), 1e5, 'UNKNOWN'),  # hardly likely the whole cause
    (Ranked('a', 500.0, 0.20, 1), 20.0, 'UNKNOWN'),
    (Ranked('a', 500.0, 0.40, 1, 0.3), 20.0, 'UNKNOWN'),  # it leaves the half of a channel
    (Ranked('a', 100.0, 0.40, 1), 0.05, 'UNKNOWN'),
    (Ranked('a', 100.0, 0.0, 1), 0.05, 'CAUSE'),  # too little to remove any, but not chance
    (Ranked('a', 3.0, 0.01, 1), 20.0, 'UNKNOWN')])
def test_words_follow_from_what_is_explained_and_what_is_left(best, structure, word):
    assert decide([best, Ranked('z', -10.0, 0.0, 1)], [], 0.95, structure, []).word == word


@pytest.mark.parametrize('removed', [0.0, 0.99])
@pytest.mark.parametrize('ceiling, word', [(0.0, 'NO_GAP'), (0.3, 'NO_GAP'), (0.8, 'UNKNOWN')])
def test_noise_is_nothing_that_the_command_could_predict(removed, ceiling, word):
    best = Ranked('a', 3.0, removed, 1)
    verdict = decide([best, Ranked('z', -10.0, 0.0, 1)], [], ceiling, 0.05, [])
    assert verdict.word == word
    assert word == 'NO_GAP' or 'a flexible correction 80 %' in verdict.reason


@pytest.mark.parametrize('channel, recording, counts', [
    (0.08, 0.0, False), (0.3, 0.0, True), (0.08, 0.2, True)])
def test_a_flexible_correction_counts_only_of_a_gap(channel, recording, counts):
    removable = SimpleNamespace(loudest=channel, share=lambda residual: 0.9)
    judge = SimpleNamespace(structure=lambda residual: recording)
    ceiling = ceiling_of(judge, removable, None, None, DEFAULTS)
    assert ceiling == (0.9 if counts else 0.0)


@pytest.mark.parametrize('structure, ceiling, removed, word', [
    (0.2, 0.0, 0.0, 'NO_GAP'), (0.2, 0.2, 0.0, 'UNKNOWN'), (0.2, 0.0, 0.2, 'UNKNOWN'),
    (0.3, 0.0, 0.0, 'UNKNOWN')])
def test_a_little_that_nothing_foretells_is_no_structure(structure, ceiling, removed, word):
    best = Ranked('a', 20.0, removed, 1, excess=structure)
    verdict = decide([best, Ranked('z', -10.0, 0.0, 1)], [], ceiling, structure, [])
    assert verdict.word == word


def test_who_removes_most_of_a_gap_comes_before_who_predicts_more_rows_and_removes_little():
    quiet, loud = Ranked('sensor_lag', 900.0, 0.1, 1, 0.7), Ranked('friction', 200.0, 0.9, 1, 0.4)
    other = Ranked('contact', 150.0, 0.3, 1, 0.8)
    verdict = decide([quiet, loud, other], [], 0.95, 50.0, [])
    assert verdict.word == 'CAUSE' and verdict.selected == ('friction',)
    assert outscored(verdict, [quiet, loud, other]) == 'sensor_lag'
    assert outscored(verdict, [loud, other]) is None
    assert probabilities([quiet, loud, other]) == pytest.approx([0.0, 1.0, 0.0])
    assert decide([quiet, other], [], 0.95, 50.0, []).word == 'UNKNOWN'
    both = Ranked('friction+sensor_lag', 1500.0, 0.99, 2, 0.05, 0.0, 300.0, 0.8)
    verdict = decide([quiet, loud, other], [both], 0.95, 50.0, [])
    assert verdict.word == 'MULTIPLE' and verdict.selected == ('friction', 'sensor_lag')


@pytest.mark.parametrize('gain, said', [(5.0, 'leakage, removes 20 %'), (0.0, 'no effect')])
def test_an_effect_that_explains_nothing_is_not_called_the_best(gain, said):
    reason = decide([Ranked('leakage', gain, 0.2, 1)], [], 0.1, 20.0, []).reason
    assert said in reason and ('leakage' in reason) == (gain > 0.0)


def test_what_shows_no_end_is_named_after_what_has_none():
    """The bend that a time constant beyond the recordings makes is the form of a steady drift."""
    warms = Ranked('thermal_drift', 1000.0, 0.999, 2, 0.01, spent=20.0, simpler='sensor_drift')
    drifts = Ranked('sensor_drift', 960.0, 0.998, 1, 0.01, spent=15.0)
    alike = [['thermal_drift', 'sensor_drift']]
    verdict = decide([warms, drifts], [], 0.999, 50.0, alike)
    assert verdict.tie == ('sensor_drift', 'thermal_drift')
    ends = replace(warms, simpler='')
    assert decide([ends, drifts], [], 0.999, 50.0, alike).selected == ('thermal_drift',)


@pytest.mark.parametrize('time_constant, simpler', [
    (31.0, 'contact+sensor_drift'), (29.0, '')])
def test_a_time_constant_shows_in_recordings_that_outlast_it(time_constant, simpler):
    fit = SimpleNamespace(effects={'contact': {}, 'thermal_drift': {
        'time_constant': time_constant}})
    evidence = SimpleNamespace(tracks=[SimpleNamespace(recording=SimpleNamespace(duration=each))
                                       for each in (0.3, 30.0)])
    assert _simpler('contact+thermal_drift', fit, evidence) == simpler
    assert _simpler('contact', fit, evidence) == ''
    # A number that was not given is at its default: five minutes.
    fit.effects['thermal_drift'] = {}
    assert _simpler('thermal_drift', fit, evidence) == 'sensor_drift'


@pytest.mark.parametrize('removed, next_removed, word', [
    (0.81, 0.11, 'CAUSE'),  # nothing else looks like it, though it has few independent rows
    (0.81, 0.6, 'UNKNOWN'),  # another does, too
    (0.70, 0.11, 'UNKNOWN')])  # it leaves too much
def test_a_cause_that_nothing_looks_like_needs_few_rows(removed, next_removed, word):
    rings = Ranked('mechanical_resonance', 9.0, removed, 4, 0.26, excess=0.35)
    other = Ranked('thermal_drift', 2.0, next_removed, 2, 0.8, excess=2.0)
    assert decide([rings, other], [], 0.14, 2.85, []).word == word


@pytest.mark.parametrize('removed, ceiling, structure, word', [
    (0.63, 0.99, 100.0, 'UNKNOWN'),
    (0.63, 0.70, 100.0, 'CAUSE'),  # nothing flexible removes much more
    (0.63, 0.99, 0.1, 'CAUSE'),  # there is hardly anything that it could learn from
    (0.95, 0.999, 100.0, 'CAUSE')])  # a form that misses a little
def test_a_cause_of_which_anything_flexible_removes_far_more_is_not_believed(
        removed, ceiling, structure, word):
    singles = [Ranked('sensor_gain', 900.0, removed, 1, 0.1), Ranked('friction', 4.0, 0.1, 1, 0.9)]
    verdict = decide(singles, [], ceiling, structure, [])
    assert verdict.word == word
    assert word == 'CAUSE' or f'sensor gain, removes {100 * removed:.0f} %' in verdict.reason


@pytest.mark.parametrize('removed, structure, sure', [
    (0.2, 20.0, True),
    (0.45, 20.0, False),  # a known effect may be so by another form
    (0.2, 0.5, False)])  # too little is left to tell
def test_what_the_library_lacks_is_doubtful_where_it_has_half_an_answer(removed, structure, sure):
    verdict = decide([Ranked('a', 500.0, removed, 1, 0.5)], [], 0.95, structure, [])
    assert verdict.word == 'UNKNOWN'
    assert (verdict.confidence > 0.9) is sure and (verdict.confidence < 0.5) is not sure
