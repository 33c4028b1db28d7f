# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The report and the summary show what the diagnosis says, whatever the names in it are."""

from base64 import b64encode
import copy
from hashlib import sha256
import html
from html.parser import HTMLParser
import io
import json
import re
import shutil
import subprocess

from piezo_stack_sim.cli import main
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.gap.quantities import percent, percent_with_interval, quantity, with_interval
from piezo_stack_sim.gap.report import render_report, write_report
from piezo_stack_sim.gap.report.chain import chain_view
from piezo_stack_sim.gap.report.sections import (
    headline_view, loops_view, parameters_view, SECTIONS)
from piezo_stack_sim.gap.report.summary import summary_lines, terminal_summary
from piezo_stack_sim.gap.report.wording import verdict_sentence
from piezo_stack_sim.gap.schema import validate, VERDICTS
from piezo_stack_sim.gap.storage import read_diagnosis, write_diagnosis
import pytest
from rich.console import Console

from synthetic_diagnosis import make_diagnosis

HOSTILE = '</script><script>alert(1)</script><img src=x onerror=alert(2)>"\'&{{ 7*7 }}'


class Page(HTMLParser):
    """What a browser would see: tags, attributes, text and the contents of scripts."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.tags, self.attributes, self.text, self.scripts = [], [], [], []
        self.inside = None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, name, value) for name, value in attrs]
        self.inside = tag
        if tag == 'script':
            self.scripts.append((dict(attrs), ''))

    def handle_endtag(self, tag):
        self.inside = None

    def handle_data(self, data):
        if self.inside == 'script':
            self.scripts[-1] = (self.scripts[-1][0], self.scripts[-1][1] + data)
        elif self.inside != 'style':
            self.text.append(data)

    @property
    def words(self):
        return ' '.join(' '.join(self.text).replace('\N{NO-BREAK SPACE}', ' ').split())


@pytest.fixture(scope='module')
def cause():
    """Return a diagnosis; tests that change it copy it first."""
    return make_diagnosis('CAUSE')


@pytest.mark.parametrize('verdict', VERDICTS)
def test_the_report_begins_with_the_verdict_in_one_sentence(verdict):
    diagnosis = make_diagnosis(verdict)
    page = Page(render_report(diagnosis))
    sentence = verdict_sentence(diagnosis)
    assert sentence.endswith('.') and '. ' not in sentence
    assert page.words.index(sentence) < 200 + len(diagnosis['name'])
    assert page.tags.count('h1') == 1


@pytest.mark.parametrize(('verdict', 'phrases'), [
    ('NO_GAP', ['agrees with the recordings to within the noise', '99 % sure']),
    ('CAUSE', ['Creep in the electrical block causes the gap', '96 % sure', 'shrinks from']),
    ('MULTIPLE', ['Creep (electrical) and amplifier bandwidth (drive) together', '94 % sure']),
    ('AMBIGUOUS', ['cannot tell creep, mount creep and thermal drift apart', '96 % sure']),
    ('UNKNOWN', ['Nothing in the library explains', 'lies in the mechanical block', '91 % sure']),
    ('NOT_IDENTIFIABLE', ['cannot say what causes the gap', 'times the noise in displacement']),
])
def test_each_verdict_says_what_how_sure_and_how_much_smaller(verdict, phrases):
    sentence = verdict_sentence(make_diagnosis(verdict))
    for phrase in phrases:
        assert phrase in sentence


def test_what_hides_in_the_noise_is_not_said_to_lie_in_a_block():
    diagnosis = make_diagnosis('UNKNOWN')
    for row in diagnosis['gap'].values():
        row['over_noise'] = 1.01
    diagnosis['where']['records'] = {'decay': 0.7, 'steps': 0.3}
    sentence = verdict_sentence(diagnosis)
    assert sentence.startswith('All in all the simulation agrees with the recordings to within')
    assert 'most of all in decay' in sentence and '91 % sure' in sentence
    assert 'block' not in sentence


def test_where_no_recording_stands_out_the_sentence_says_so_like_its_reason():
    diagnosis = make_diagnosis('UNKNOWN')
    for row in diagnosis['gap'].values():
        row['over_noise'] = 1.01
    diagnosis['reason'] = (
        'no recording stands out of the noise; the best effect, creep, removes 20 % of the '
        'removable gap in all channels together, a flexible correction 80 %')
    sentence = verdict_sentence(diagnosis)
    assert 'but a flexible correction finds something in them that nothing in the lib' in sentence
    assert 'stands out' not in sentence


@pytest.mark.parametrize(('times', 'score', 'channel'), [
    (0.99, None, 'charge'), (1.02, 0.4, 'charge'), (3.0, None, 'charge'),
    (1.3, 0.9, 'displacement')])
def test_where_the_displacement_has_no_gap_the_widest_is_told_of(times, score, channel):
    diagnosis = make_diagnosis('CAUSE')
    diagnosis['gap']['displacement']['over_noise'] = times
    diagnosis['shrinkage']['displacement']['S'] = score
    diagnosis['shrinkage']['voltage'].update(S=None, ci=None)
    diagnosis['gap']['voltage']['over_noise'] = 900.0  # of no gap to remove nobody speaks first
    assert f'the {channel} error shrinks from' in verdict_sentence(diagnosis)
    assert f'{channel} rms; ' in headline_view(diagnosis)['smaller']['note']


def test_where_there_is_no_gap_at_all_the_displacement_is_told_of():
    diagnosis = make_diagnosis('NO_GAP')
    for channel in diagnosis['gap']:
        diagnosis['shrinkage'][channel].update(S=None, ci=None)
    assert 'rms displacement' in headline_view(diagnosis)['smaller']['note']


def test_the_sentence_gives_the_score_that_follows_from_the_powers(cause):
    row = cause['shrinkage']['displacement']
    score = 1 - (row['after'] - row['noise']) / (row['before'] - row['noise'])
    assert f'{percent(score, 1)} [' in verdict_sentence(cause)


def test_what_is_switched_on_as_a_pair_shows_the_numbers_of_the_pair(cause):
    one, two, three = cause['causes'][:3]
    pairs = [{**one, 'effect': f'{one["effect"]}+{other["effect"]}'} for other in (two, three)]
    both = {**cause, 'verdict': 'MULTIPLE', 'selected': [one['effect'], two['effect']],
            'ambiguity_set': [], 'causes': [*pairs, *cause['causes']]}
    shown = parameters_view(both)['causes']
    assert [(each['effect'], each['on']) for each in shown] == [(pairs[0]['effect'], True)]


def test_every_section_stands_in_the_report(cause):
    page = Page(render_report(cause))
    anchors = {value for tag, name, value in page.attributes if tag == 'section' and name == 'id'}
    assert anchors == {section.id for section in SECTIONS}
    for words in ('creep', 'mount creep', 'gain per decade', 'placebo 1.2 %', 'ceiling 99.1 %',
                  'at a bound', 'transformer ratio', 'piezo_stack excite steps', 'row before'):
        assert words in page.words


@pytest.fixture
def exchangeable():
    """Return a diagnosis of two causes of which the second may be a lag of the sensor."""
    diagnosis = make_diagnosis('MULTIPLE')
    for rank, (effect, chance) in enumerate((('creep+amplifier_bandwidth', 0.6),
                                             ('creep+sensor_lag', 0.34),
                                             ('creep+added_mass', 0.0))):
        diagnosis['causes'].insert(rank, {
            **diagnosis['causes'][0], 'effect': effect, 'probability': chance})
    diagnosis['ambiguity_set'] = ['amplifier_bandwidth', 'sensor_lag']
    return diagnosis


def test_of_two_causes_what_may_be_exchanged_is_said_in_words(exchangeable):
    sentence = verdict_sentence(exchangeable)
    assert 'Creep (electrical) and amplifier bandwidth (drive) or sensor lag (sensor)' in sentence
    page = Page(render_report(exchangeable))
    assert 'creep + (amplifier bandwidth or sensor lag)' in page.words
    lines = [line for line, _ in summary_lines(exchangeable) if 'tie' in line]
    assert len(lines) == 2 and all('creep +' in line for line in lines)


@pytest.mark.parametrize(('drive', 'channels', 'drawn'), [
    ('voltage', ['displacement'], True), ('charge', ['displacement'], True),
    ('charge', ['charge'], False), ('voltage', ['voltage'], False), ('open', [], False),
    ('open', ['displacement'], False), ('open', ['voltage', 'displacement'], True)])
def test_loops_are_shown_where_two_are_known_the_command_being_one(cause, drive, channels, drawn):
    recording = copy.deepcopy(cause['traces']['recordings'][0])
    view = recording['views']['overview']
    view['channels'] = {name: view['channels'][name] for name in channels}
    view['command'] = None if drive == 'open' else view['command']
    given = {**cause, 'traces': {'recordings': [{**recording, 'drive': drive}]}}
    assert (loops_view(given) is not None) == drawn


def test_what_was_not_preferred_is_not_called_the_best_that_can_be_had():
    diagnosis = make_diagnosis('AMBIGUOUS')
    other = diagnosis['next_experiment']['alternatives'][0]
    other['separation'] = 0.1  # which says nothing of the programme that was preferred
    page = Page(render_report(diagnosis))
    assert 'No programme tells' not in page.words
    assert 'Play triangle with frequency 0.1 0.10 × noise' in page.words
    diagnosis['next_experiment']['separation'] = 0.3
    assert Page(render_report(diagnosis)).words.count('No programme tells') == 2  # tile, section


@pytest.mark.parametrize(('verdict', 'here', 'told'), [
    ('AMBIGUOUS', ('electrical', 'mechanical', 'environment'), 'electrical, mechanical or '
     'environment block'),
    ('CAUSE', ('electrical',), 'electrical block')])
def test_a_cut_of_many_blocks_is_shown_as_one_and_a_tie_in_all_of_its_blocks(verdict, here, told):
    diagnosis = make_diagnosis(verdict)
    spans = ['drive', 'electrical', 'transducer', 'mechanical', 'environment', 'sensor']
    diagnosis['where'].update(block='electrical', shares={'electrical': 1.0}, blocks={
        'electrical': {'over_noise': 9.0, 'ci': [8.0, 10.0], 'from': ['command'],
                       'to': 'displacement', 'spans': spans}})
    validate(diagnosis)
    cards = chain_view(diagnosis)['blocks']
    assert [block for block in spans if cards[block]['guilty']] == sorted(here, key=spans.index)
    assert {cards[block]['level'] for block in here} == {4}
    assert {cards[block]['note'] for block in spans} == {'', 'in one cut with electrical'}
    page = Page(render_report(diagnosis)).words
    assert f'{told} ' in page and ('or here' in page) == (verdict == 'AMBIGUOUS')


@pytest.mark.parametrize(('block', 'said'), [('sensor', True), ('drive', False)])
def test_a_reading_that_is_wrong_is_said_to_show_in_the_cuts_beside_it(block, said):
    diagnosis = make_diagnosis('UNKNOWN')
    diagnosis['where'].update(block=block, shares={'drive': 0.99, 'sensor': 0.01})
    page = Page(render_report(diagnosis)).words
    assert ('a reading that is wrong shows before and behind it' in page) == said


def test_a_block_that_nothing_points_to_is_said_to_be_a_guess():
    diagnosis = make_diagnosis('UNKNOWN')
    block = diagnosis['where']['block']
    diagnosis['where'].update(shares={block: 1.0}, blocks={block: {
        'over_noise': 9.0, 'from': ['command'], 'to': 'displacement', 'spans': ['drive', block]}})
    assert f'lies in the {block} block' in verdict_sentence(diagnosis)
    diagnosis['where']['blocks'][block]['note'] = 'nothing points to it'
    assert (f'lies between command and displacement with 100 % of its power, perhaps in the '
            f'{block} block') in verdict_sentence(diagnosis).replace(chr(0xa0), ' ')


def test_a_tie_is_shown_as_a_tie():
    rows = re.findall(r'<tr class="tied.*?</tr>', render_report(make_diagnosis('AMBIGUOUS')), re.S)
    assert len(rows) == 3
    assert all('>tie<' in row for row in rows)


def test_the_values_that_were_written_stand_beside_those_that_were_tuned_alone(cause):
    assert '6.014 MN/m' in Page(render_report(cause)).words
    assert 'In corrected.yaml' not in Page(render_report(make_diagnosis('UNKNOWN'))).words


def test_a_parameter_at_its_bound_is_flagged():
    diagnosis = make_diagnosis('CAUSE')
    diagnosis['causes'][0]['parameters']['onset']['at_bound'] = 'upper'
    assert 'at its upper bound: distrust' in render_report(diagnosis)


def test_a_diagnosis_without_anything_optional_still_gives_a_report(cause):
    required = ('schema', 'verdict', 'gap', 'where', 'isolability', 'calibration', 'causes',
                'selected', 'ambiguity_set', 'shrinkage', 'next_experiment', 'warnings')
    bare = {key: copy.deepcopy(cause[key]) for key in required}
    bare.update(causes=[], selected=[], ambiguity_set=[], calibration={}, gap={}, warnings=[],
                verdict='UNKNOWN', next_experiment=None,
                shrinkage={'placebo': None, 'ceiling': None, 'withheld': []},
                where={'block': None, 'shares': {}, 'channels': {}, 'bands': [], 'regimes': [],
                       'records': {}})
    validate(bare)
    assert 'Nothing in the library explains the gap' in Page(render_report(bare)).words
    assert summary_lines(bare)


def _poison(value, key=None):
    """Return a copy in which every text that could come from a file is hostile."""
    if isinstance(value, dict):
        return {name: _poison(item, name) for name, item in value.items()}
    if isinstance(value, list):
        return [_poison(item, key) for item in value]
    fixed = {'schema', 'verdict', 'drive', 'role', 'severity', 'block', 'at_bound'}
    return HOSTILE if isinstance(value, str) and key not in fixed else value


def test_hostile_names_are_shown_and_not_obeyed():
    hostile = _poison(make_diagnosis('AMBIGUOUS'))
    hostile['where']['records'] = {HOSTILE: 1.0}
    hostile['calibration'] = {HOSTILE: hostile['calibration']['stiffness']}
    hostile['how']['settings'] = {HOSTILE: {HOSTILE: [HOSTILE]}}
    hostile['next_experiment']['settings'] = {HOSTILE: HOSTILE}
    for cause in hostile['causes']:
        cause['parameters'] = {HOSTILE: next(iter(cause['parameters'].values()))}
    plain = Page(render_report(make_diagnosis('AMBIGUOUS')))
    text = render_report(hostile)
    page = Page(text)
    assert page.tags.count('script') == plain.tags.count('script') == 2
    assert 'img' not in page.tags
    assert not [name for _, name, _ in page.attributes if name.startswith('on')]
    assert {tag for tag, _, _ in page.attributes} <= {tag for tag, _, _ in plain.attributes}
    assert '<script>alert' not in text
    assert HOSTILE in page.words
    data = json.loads(page.scripts[0][1])
    assert data['recordings'][0]['name'] == HOSTILE


def test_the_report_loads_nothing_from_elsewhere(cause):
    text = render_report(cause)
    page = Page(text)
    for tag, name, value in page.attributes:
        if name in ('src', 'srcset', 'href', 'action', 'data', 'poster', 'xlink:href'):
            assert value.startswith('#'), (tag, name, value)
    assert not {'link', 'img', 'iframe', 'object', 'embed', 'base', 'form'} & set(page.tags)
    style = ''.join(re.findall(r'<style>(.*?)</style>', text, re.S))
    assert 'url(' not in style and '@import' not in style
    addresses = set(re.findall(r'(?:https?:)?//[\w.]+\.\w+[^\s\'"]*', text))
    assert addresses <= {'http://www.w3.org/2000/svg'}   # a name, which nothing fetches
    for call in ('fetch(', 'XMLHttpRequest', 'import(', 'eval(', 'innerHTML', 'sendBeacon'):
        assert call not in text


def test_the_page_runs_its_own_script_and_no_other(cause):
    page = Page(render_report(cause))
    policy = next(value for tag, name, value in page.attributes
                  if tag == 'meta' and name == 'content' and 'default-src' in value)
    code = [body for attributes, body in page.scripts if 'type' not in attributes]
    assert len(code) == 1
    digest = b64encode(sha256(code[0].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy
    assert "default-src 'none'" in policy and 'unsafe-eval' not in policy


def test_the_same_diagnosis_gives_the_same_report_also_from_its_file(cause, tmp_path):
    write_diagnosis(cause, tmp_path / 'diagnosis.json')
    again = read_diagnosis(tmp_path / 'diagnosis.json')
    assert render_report(again) == render_report(cause)
    assert len(render_report(cause).encode()) < 5e6


def test_a_failed_report_leaves_the_old_one(cause, tmp_path):
    path = tmp_path / 'report.html'
    path.write_text('old')
    with pytest.raises(KeyError):
        write_report({**cause, 'verdict': 'MAYBE'}, path)
    assert path.read_text() == 'old'
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(InputError, match='cannot be written'):
        write_report(cause, path / 'inside.html')


# --- the terminal


def _crowded():
    """Return a diagnosis with more of everything than fits."""
    crowded = make_diagnosis('AMBIGUOUS')
    crowded['ambiguity_set'] = [cause['effect'] for cause in crowded['causes']]
    crowded['selected'] = crowded['ambiguity_set'][:4]
    crowded['gap'] = {f'channel_{letter}': crowded['gap']['charge'] for letter in 'abcdefgh'}
    crowded['warnings'] = 40 * ['a warning that is much longer than any line can be ' * 4]
    crowded['files'] = {str(n): f'/a/long/folder/file_{n}.html' for n in range(9)}
    crowded['name'] = 'a name that goes on and on ' * 10
    validate(crowded)
    return crowded


@pytest.mark.parametrize('width', [40, 60, 80, 120, 200])
@pytest.mark.parametrize('verdict', [*VERDICTS, None])
def test_the_summary_has_at_most_25_lines(verdict, width):
    diagnosis = make_diagnosis(verdict) if verdict else _crowded()
    lines = [line for line, _ in summary_lines(diagnosis, width)]
    assert len(lines) <= 25
    assert all(len(line) <= width for line in lines if not line.startswith('Wrote'))


@pytest.mark.parametrize('verdict, confidence, says', [
    ('UNKNOWN', 0.95, True), ('CAUSE', 0.48, True), ('CAUSE', 0.95, False),
    ('AMBIGUOUS', 0.58, True), ('AMBIGUOUS', 0.9, False)])
def test_what_is_unknown_or_doubtful_says_why_on_the_terminal(verdict, confidence, says):
    diagnosis = {**make_diagnosis(verdict), 'confidence': confidence}
    text = ' '.join(' '.join(line for line, _ in summary_lines(diagnosis)).split())
    assert (f'Why {diagnosis["reason"][0].upper()}{diagnosis["reason"][1:]}.' in text) == says


def test_the_summary_says_it_all(cause):
    text = '\n'.join(line for line, _ in summary_lines(cause, 100))
    for words in ('Cause found: bench', 'Creep in the electrical block', '78.0 nm', '11.1 nm',
                  'electrical 83 %', 'steps 79 %', '1 creep', '2 mount creep',
                  'Data    repaired: bench/steps.csv: 3 rows have', '(1 more in the report)',
                  'Next    Play steps', 'Warning damping', 'out/report.html',
                  'out/corrected.yaml'):
        assert words in text


def _where_lines(**where):
    diagnosis = make_diagnosis('UNKNOWN')
    diagnosis['where'].update(where)
    lines = [line for line, _ in summary_lines(diagnosis, 100)]
    first = next(i for i, line in enumerate(lines) if line.startswith('Where'))
    return lines[first:first + 2]


def test_the_summary_names_the_block_before_what_the_cuts_say():
    first, _ = _where_lines(block='sensor', shares={'mechanical': 0.95, 'drive': 0.046,
                                                    'electrical': 0.004})
    assert first == 'Where   sensor block; by the cuts mechanical 95 % and drive 5 %'


@pytest.mark.parametrize(('block', 'shares', 'line'), [
    ('sensor', {'mechanical': 0.0}, 'sensor block'), ('sensor', {}, 'sensor block'),
    (None, {'drive': 1.0}, 'drive 100 %'), (None, {}, 'cannot be said')])
def test_the_summary_says_of_the_block_what_is_known(block, shares, line):
    assert _where_lines(block=block, shares=shares)[0] == f'Where   {line}'


def test_the_summary_names_the_blocks_of_all_that_together_cause_a_gap():
    lines = [line for line, _ in summary_lines(make_diagnosis('MULTIPLE'), 100)]
    assert any(line.startswith('Where   electrical and drive blocks; by the cuts electrical 83 %')
               for line in lines)


def test_shares_of_nothing_are_not_told():
    none = {'name': 'rising', 'share': 0.0}
    assert _where_lines(records={'steps': 0.0}, regimes=[none],
                        bands=[{'low': 1000.0, 'high': None, 'share': 0.7},
                               {'low': 1.0, 'high': 10.0, 'share': 0.3}])[1] == (
        '        above 1000 Hz 70 %')
    assert not _where_lines(records={'steps': 0.0}, regimes=[none], bands=[
        {'low': 0.0, 'high': 1.0, 'share': 0.0}])[1].startswith(' ')


def test_the_summary_is_plain_in_a_pipe_and_coloured_on_a_terminal(cause):
    pipe, terminal = io.StringIO(), io.StringIO()
    terminal_summary(cause, Console(file=pipe, width=80))
    terminal_summary(cause, Console(file=terminal, width=80, force_terminal=True))
    assert '\x1b' not in pipe.getvalue()
    assert '\x1b[' in terminal.getvalue()


def test_names_cannot_steer_the_terminal(cause):
    hostile = copy.deepcopy(cause)
    hostile['name'] = '\x1b[2J\x07[red]bench[/red]\n\nfake line'
    hostile['files'] = {'report': 'a\rb\x1b]0;title\x07.html'}
    pipe = io.StringIO()
    terminal_summary(hostile, Console(file=pipe, width=80))
    text = pipe.getvalue()
    assert not set(text) & {'\x1b', '\x07', '\r'}
    assert '[red]bench[/red]' in text.splitlines()[0]


def test_a_terminal_without_utf_8_gets_ascii(cause):
    raw = io.BytesIO()
    console = Console(file=io.TextIOWrapper(raw, encoding='ascii', write_through=True), width=80)
    terminal_summary(cause, console)
    assert b'x noise' in raw.getvalue()


# --- the command


def test_the_report_command_needs_nothing_but_the_file(cause, tmp_path, capsys):
    write_diagnosis(cause, tmp_path / 'diagnosis.json')
    assert main(['report', str(tmp_path / 'diagnosis.json')]) == 0
    assert (tmp_path / 'report.html').read_text('utf-8') == render_report(cause)
    assert 'Cause found' in capsys.readouterr().out


@pytest.mark.parametrize(('content', 'words'), [
    (b'{"schema": ', 'expected JSON'),
    (b'\xff\xfe{}', 'not UTF-8'),
    (b'[' * 100_000, 'expected'),
    (b'[]', 'expected object'),
    (b'{"schema": "piezo_stack_sim/diagnosis/1"}', 'is missing'),
    (None, 'cannot be read'),
])
def test_a_wrong_file_ends_in_one_line_and_status_2(content, words, tmp_path, capsys):
    path = tmp_path / 'diagnosis.json'
    if content is not None:
        path.write_bytes(content)
    assert main(['report', str(path)]) == 2
    error = capsys.readouterr().err
    assert words in error and str(path) in error
    assert error.count('\n') == 1
    assert not (tmp_path / 'report.html').exists()


# --- in a browser


@pytest.mark.skipif(not shutil.which('chromium'), reason='needs chromium')
def test_a_browser_draws_the_plots(cause, tmp_path):
    write_report(cause, tmp_path / 'report.html')
    shown = subprocess.run(
        ['chromium', '--headless', '--no-sandbox', '--disable-gpu', '--disable-quic',
         '--no-first-run', '--disable-background-networking', '--disable-component-update',
         '--disable-sync', f'--user-data-dir={tmp_path}/profile', '--virtual-time-budget=4000',
         '--dump-dom', (tmp_path / 'report.html').as_uri()],
        capture_output=True, text=True, timeout=120).stdout
    assert len(re.findall(r'<path class="line before" d="M[^"]{300,}"', shown)) >= 9
    assert 'Displacement (µm)' in html.unescape(shown)


# --- numbers as a reader wants them


@pytest.mark.parametrize(('value', 'unit', 'text'), [
    (3.8e-8, 'm', '38.0 nm'), (999.96e-9, 'm', '1.00 µm'), (-1.2e-5, 'm', '−12.0 µm'),
    (6e6, 'N/m', '6.00 MN/m'), (0.00375, 'kg', '3.75 g'), (300.0, 's', '300 s'),
    (0.012, '', '0.0120'), (0.0, 'm', '0 m'), (None, 'm', '–'), (4.2e-3, 'V', '4.20 mV'),
])
def test_quantities_read_well(value, unit, text):
    assert quantity(value, unit) == text


def test_a_value_and_its_interval_share_one_unit():
    assert with_interval(1.3e-6, [0.9e-6, None], 'm') == '1.30 [0.900, ∞] µm'
    # A narrow one is no point.
    assert with_interval(637.373, [637.281, 637.465], 'Hz') == '637.37 [637.28, 637.47] Hz'
    assert with_interval(1.0, [1.0, 1.0], 'V') == '1.00 [1.00, 1.00] V'


@pytest.mark.parametrize(('fraction', 'ci', 'text'), [
    (0.98, [0.97, 0.99], ('98 %', '[97, 99]')),
    (0.9996, [0.9994, 0.9999], ('99.96 %', '[99.94, 99.99]')),
    (0.992, [0.985, 0.998], ('99.2 %', '[98.5, 99.8]')),
    (0.03, [-0.01, 0.062], ('3.0 %', '[−1.0, 6.2]')),
    (1.0, [0.9, 1.0], ('100 %', '[90, 100]')),
    (0.95, [0.9, None], ('95 %', '[90, ∞]')),
    (0.95, [None, None], ('95 %', '')),
    (0.95, None, ('95 %', '')),
])
def test_a_part_and_its_interval_have_as_many_decimals(fraction, ci, text):
    assert percent_with_interval(fraction, ci) == text


def test_nearly_certain_is_not_certain():
    assert [percent(p) for p in (0, 0.001, 0.5, 0.9999, 1)] == \
        ['0 %', '< 1 %', '50 %', '> 99 %', '100 %']


def test_hardly_less_than_nothing_is_nothing():
    assert [percent(p, 1) for p in (-1e-4, -0.01)] == ['0 %', '−1.0 %']


def test_what_explains_nothing_is_no_candidate(cause):
    idle = {**cause, 'causes': [{**each, 'delta_log_score': 0.0} for each in cause['causes']]}
    assert 'Causes' in [line for line, _ in summary_lines(cause)]
    assert 'Causes' not in [line for line, _ in summary_lines(idle)]
