# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The paper's figures: what they show, in numbers, and that they come out the same again."""

import json
from pathlib import Path
import xml.etree.ElementTree as ElementTree

import numpy as np
from piezo_stack_sim import figures, plotting
from piezo_stack_sim.cli import main
from piezo_stack_sim.figures.maxwell import parameters
from piezo_stack_sim.resources import config_file
import pytest

DOC = Path(__file__).resolve().parents[1] / 'doc'


@pytest.fixture(scope='module')
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp('figures')
    page = folder / 'page.md'
    assert main(['figures', '--out', str(folder / 'out'), '--page', str(page)]) == 0
    return folder / 'out', page


@pytest.fixture(scope='module')
def numbers(drawn):
    result = json.loads((drawn[0] / 'figures.json').read_text())
    return {figure['name']: {row['name']: row['value'] for row in figure['numbers']}
            for figure in result['figures']}


def test_every_figure_is_there_as_png_and_svg(drawn):
    for name in figures.IDS:
        assert (drawn[0] / f'{name}.png').read_bytes().startswith(b'\x89PNG')
        assert ElementTree.parse(drawn[0] / f'{name}.svg').getroot().tag.endswith('svg')


def test_triangles_reach_and_leave_what_the_model_says(numbers):
    ten = numbers['figure_10']
    for peak, reached, left in (
            (30, 3.0228, 0.6008), (60, 7.3923, 1.3371), (90, 12.4308, 2.1652)):
        assert ten[f'first peak, {peak} V'] * 1e6 == pytest.approx(reached, abs=1e-3)
        assert ten[f'offset, {peak} V'] * 1e6 == pytest.approx(left, abs=1e-3)
    assert abs(ten['phase lag at the peaks']) < 0.5


def test_voltage_loops_are_a_fifth_of_the_stroke_at_every_speed(numbers):
    assert numbers['figure_11']['loop width of stroke, 90 V'] == pytest.approx(0.198, abs=0.003)
    assert abs(numbers['figure_02']['change of loop width with speed']) < 0.01


def test_gain_jumps_where_the_voltage_turns(numbers):
    assert numbers['figure_11']['gain before and after the turn'] > 4.0


def test_charge_and_displacement_show_no_loop(numbers):
    three = numbers['figure_03']
    assert three['q-x loop at 100 Hz'] < 0.001 < 0.15 < three['v-x loop at 100 Hz']
    # At 1000 Hz the linear second-order lag is left, and nothing else.
    assert three['q-x loop at 1000 Hz'] == pytest.approx(
        np.sin(np.radians(0.557)), rel=0.15)
    assert three['marks off the line'] < 0.01


def test_open_leads_are_stiffer_and_show_no_loop(numbers):
    four, thirteen = numbers['figure_04'], numbers['figure_13']
    assert four['open-lead stiffness'] == pytest.approx(89.3333e6, rel=1e-5)
    assert four['stiffness ratio'] == pytest.approx(1.615, abs=0.002)
    assert four['open loop width'] < 1e-15 < four['shorted loop width']
    assert thirteen['first minimum, shorted'] * 1e6 == pytest.approx(-3.84083, abs=2e-3)
    assert thirteen['left at the end of a cycle, shorted'] * 1e6 == pytest.approx(
        -0.2256, abs=1e-3)
    assert thirteen['minimum, open'] * 1e6 == pytest.approx(-2.23881, abs=1e-3)
    assert thirteen['loop width of travel, open'] < 0.001


def test_the_rising_curve_alone_gives_table_2_back(numbers):
    assert numbers['figure_07_08']['stiffnesses off Table 2'] < 1e-9
    assert numbers['figure_07_08']['break voltages off Table 2'] < 1e-9


def test_parameters_of_two_pieces_by_hand():
    stiffness, volts, slopes = parameters(np.array([0.0, 1.0, 3.0]), np.array([0.0, 5.0, 9.0]))
    assert slopes.tolist() == [5.0, 2.0]
    assert stiffness.tolist() == [3.0, 2.0] and volts.tolist() == [3.0, 6.0]


def test_the_page_shows_every_figure_with_its_numbers(drawn, numbers):
    text = drawn[1].read_text(encoding='utf-8')
    for name in figures.IDS:
        assert f'(out/{name}.png)' in text
    assert all(f'| {row} |' in text for figure in numbers.values() for row in figure)
    assert 'Figures 7 and 8' in text


@pytest.mark.skipif(not (DOC / 'figures' / 'figures.json').is_file(), reason='no doc folder')
def test_the_page_in_the_documentation_is_up_to_date(numbers):
    kept = json.loads((DOC / 'figures' / 'figures.json').read_text())
    assert [figure['name'] for figure in kept['figures']] == list(figures.IDS)
    for figure in kept['figures']:
        for row in figure['numbers']:
            assert numbers[figure['name']][row['name']] == pytest.approx(
                row['value'], rel=1e-3, abs=1e-10), row['name']


def test_a_picture_comes_out_the_same_to_the_byte(drawn, tmp_path):
    assert main(['figures', '--out', str(tmp_path), '--only', 'figure_04']) == 0
    for suffix in ('png', 'svg'):
        again = (tmp_path / f'figure_04.{suffix}').read_bytes()
        assert again == (drawn[0] / f'figure_04.{suffix}').read_bytes()
    assert not (tmp_path / 'figure_02.png').exists()


def test_figures_of_another_actuator_stay_in_its_range(tmp_path):
    text = config_file('ae0505d16_full_range.yaml').read_text()
    path = tmp_path / 'small.yaml'
    path.write_text(text.replace('[0.0, 150.0]', '[0.0, 60.0]'))
    assert main(['figures', '--out', str(tmp_path), '--params', str(path), '--only', 'figure_11',
                 '--only', 'figure_07_08']) == 0
    result = json.loads((tmp_path / 'figures.json').read_text())
    assert any(row['name'] == 'loop width, 60 V' for row in result['figures'][0]['numbers'])


def test_an_unknown_figure_is_named_with_the_known_ones(tmp_path, capsys):
    assert main(['figures', '--out', str(tmp_path), '--only', 'figure_99']) == 2
    assert 'figure_10' in capsys.readouterr().err


def test_lines_are_told_apart_in_grey():
    from matplotlib.colors import to_rgb
    grey = [np.dot(to_rgb(colour), (0.299, 0.587, 0.114)) for colour, _ in plotting.LINES]
    assert np.diff(grey).min() > 0.0 and grey[1] - grey[0] > 0.2 and grey[2] - grey[1] > 0.15
    assert len({str(dash) for _, dash in plotting.LINES}) == len(plotting.LINES)


def test_the_style_leaves_the_users_own_untouched():
    import matplotlib
    before = dict(matplotlib.rcParams)
    with plotting.style():
        plotting.new_figure()
    assert dict(matplotlib.rcParams) == before
