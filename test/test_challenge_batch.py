# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""A batch is reproducible, readable as any recording set, and committed to its labels."""

from dataclasses import replace
import gzip
import json
import shutil

from click.testing import CliRunner
import numpy as np
from piezo_stack_sim.challenge import case, labels, make, programmes
from piezo_stack_sim.cli import main
from piezo_stack_sim.commands.challenge import command
from piezo_stack_sim.errors import InputError
import pytest

SHORT = programmes.Plan(
    triangle_rate=5e3, triangle_frequency=20.0, triangle_peaks=(90.0,), steps_rate=500.0,
    steps_hold=0.5, steps_levels=(0.0, 60.0), names=('triangle', 'steps'))


@pytest.fixture
def short(monkeypatch):
    """Make recordings of a second instead of half a minute."""
    monkeypatch.setattr(programmes, 'draw', lambda random, needed=(): SHORT)


def batch(folder, seed=11, hidden=(('one', ('creep',)), ('none', ()))):
    """Make a small batch in this process; return its public folder."""
    out = folder / 'public'
    for index, (kind, ids) in enumerate(hidden):
        make.make_set(out, index, seed, kind, ids)
    truth = labels.truth_folder(out)
    labels.commit(out, {'seed': seed, 'sets': {
        make.set_name(i): json.loads((truth / f'{make.set_name(i)}.json').read_text())
        for i in range(len(hidden))}})
    return out


def test_the_same_seed_makes_the_same_bytes(short, tmp_path):
    """Recordings, parameter files, labels and hash; another seed makes others."""
    first, second = batch(tmp_path / 'a'), batch(tmp_path / 'b')
    files = sorted(path.relative_to(first) for path in first.rglob('*') if path.is_file())
    assert files
    for path in files:
        assert (first / path).read_bytes() == (second / path).read_bytes()
    assert labels.label_file(first).read_bytes() == labels.label_file(second).read_bytes()
    other = batch(tmp_path / 'c', seed=12)
    assert (other / 'labels.sha256').read_text() != (first / 'labels.sha256').read_text()


@pytest.mark.slow
def test_a_patchy_batch_is_the_same_but_for_its_holes(short, tmp_path):
    """The same devices, the same noise; some readings are missing, and the reader says so."""
    from piezo_stack_sim.recording.read import read_set
    whole, seen = batch(tmp_path / 'a'), []
    out = tmp_path / 'b' / 'public'
    for index, hidden in enumerate((('one', ('creep',)), ('none', ()))):
        make.make_set(out, index, 11, *hidden, patchy=True)
        name = make.set_name(index)
        assert (out / 'devices' / f'{name}.yaml').read_bytes() == (
            whole / 'devices' / f'{name}.yaml').read_bytes()
        for one, other in zip(read_set([str(whole / name)]).recordings,
                              read_set([str(out / name)]).recordings):
            assert np.array_equal(one.command, other.command)
            for channel, values in other.measured.items():
                there = ~np.isnan(values)
                assert np.array_equal(values[there], one.measured[channel][there])
                seen.append(there.mean())
    assert min(seen) < 0.999 and min(seen) > 0.1
    assert make.batch_id(9, 7) != make.batch_id(9, 7, patchy=True)


@pytest.mark.parametrize('seed', range(20))
def test_a_slow_sensor_is_slow_in_every_recording_of_its_set(seed):
    """Besides, at most one message in twenty is lost."""
    whole = [{'displacement': np.ones(n), 'charge': np.ones(n)} for n in (4000, 1600)]
    held = make.with_holes(whole, np.random.default_rng(seed))
    for channel in whole[0]:
        parts = [float(np.mean(~np.isnan(each[channel]))) for each in held]
        assert parts[0] == pytest.approx(parts[1], abs=0.03)
        assert any(0.94 / every <= parts[0] <= 1.0 / every for every in (1, 2, 4, 5, 8))


def test_the_public_folder_does_not_tell_what_is_hidden(short, tmp_path):
    """Neither names nor seed, in no file."""
    out = batch(tmp_path)
    for path in out.rglob('*'):
        if path.is_file():
            content = path.read_bytes()
            content = gzip.decompress(content) if path.suffix == '.gz' else content
            assert not any(key.encode() in content for key in case.EFFECTS)


def test_labels_prove_themselves(short, tmp_path):
    """The committed labels are accepted, and one changed digit is not."""
    out = batch(tmp_path)
    revealed = labels.reveal(out)
    assert [entry['kind'] for entry in revealed['sets'].values()] == ['one', 'none']
    path = labels.label_file(out)
    path.write_text(path.read_text().replace('"creep"', '"friction"'))
    with pytest.raises(InputError, match='not the labels'):
        labels.reveal(out)


def test_recordings_read_like_any_others(short, tmp_path):
    """The project's reader takes set and parameter file, and finds nothing to complain about."""
    from piezo_stack_sim.plant import load_device
    from piezo_stack_sim.recording.read import read_set
    out = batch(tmp_path)
    device = load_device(out / 'devices' / 'set_000.yaml')
    assert device.actuator.relative_uncertainty == case.UNCERTAINTY
    given = read_set(out / 'set_000')
    assert {recording.name for recording in given.recordings} == {'triangle', 'steps'}
    for recording in given.recordings:
        assert np.isfinite(recording.measured['displacement']).all()
        assert not recording.findings


def test_a_device_without_effects_differs_from_its_file_by_noise_and_scatter(short, tmp_path):
    """Where nothing is hidden the recordings are what the labels' noise says."""
    out = batch(tmp_path)
    label = labels.reveal(out)['sets']['set_001']
    with gzip.open(out / 'set_001' / 'triangle.csv.gz', 'rt') as stream:
        columns = stream.readline().strip().split(',')
        rows = dict(zip(columns, np.loadtxt(stream, delimiter=',').T))
    truth = np.load(labels.truth_folder(out) / 'set_001.npz')
    error = rows['displacement'][::make.KEPT_ROWS] - truth['true/triangle/displacement']
    assert 0.6 < error.std() / label['noise']['displacement']['rms'] < 1.6
    assert label['gap']['displacement']['triangle'] == 0.0


def test_an_effect_is_as_large_as_its_label_says(short, tmp_path):
    """The label's mean square is that of the noise-free difference."""
    out = batch(tmp_path)
    label = labels.reveal(out)['sets']['set_000']
    truth = np.load(labels.truth_folder(out) / 'set_000.npz')
    difference = truth['true/steps/displacement'] - truth['clean/steps/displacement']
    assert np.isclose(np.mean(difference.astype(float) ** 2),
                      label['gap']['displacement']['steps'], rtol=0.1)
    assert label['effects'][0]['over_noise_calibrated']['displacement'] >= case.VISIBLE['one']


def test_a_current_limit_that_is_never_met_is_drawn_again(short, tmp_path, monkeypatch):
    """All that shows of it is the resistance behind it, which is another effect."""
    limits = iter([100.0, 0.006])
    hidden = case.EFFECTS['amplifier_current_limit']
    monkeypatch.setitem(case.EFFECTS, hidden.key, replace(hidden, ranges=hidden.ranges | {
        'limit': lambda random, context: next(limits),
        'resistance': lambda random, context: 25.0}))
    out = batch(tmp_path, hidden=[('one', (hidden.key,))])
    label = labels.reveal(out)['sets']['set_000']
    assert label['attempts'] == 2
    assert label['effects'][0]['parameters']['limit'] == 0.006


def test_where_no_command_ever_meets_a_current_limit_another_setting_is_drawn(
        short, tmp_path, monkeypatch):
    """A device would hide a resistance only, under the name of the limit."""
    limits = iter([100.0] * case.TRIES + [0.006])
    hidden = case.EFFECTS['amplifier_current_limit']
    monkeypatch.setitem(case.EFFECTS, hidden.key, replace(hidden, ranges=hidden.ranges | {
        'limit': lambda random, context: next(limits),
        'resistance': lambda random, context: 25.0}))
    settings = []
    draw = case.draw_setting
    monkeypatch.setattr(case, 'draw_setting', lambda *given: settings.append(
        draw(*given)) or settings[-1])
    out = batch(tmp_path, hidden=[('one', (hidden.key,))])
    label = labels.reveal(out)['sets']['set_000']
    assert label['attempts'] == case.TRIES + 1
    assert label['effects'][0]['parameters']['limit'] == 0.006
    first, last = settings
    assert label['scatter']['C'] == last.clean.stack.C / last.file.C - 1.0
    assert label['scatter']['C'] != first.clean.stack.C / first.file.C - 1.0


def test_an_effect_that_the_other_of_a_pair_hides_is_drawn_again(short, tmp_path, monkeypatch):
    """A driver at its rail never brings the stack to a stop that stands further out."""
    rails = iter([40.0, 80.0])
    contact, saturation = (case.EFFECTS[key] for key in ('contact', 'amplifier_saturation'))
    monkeypatch.setitem(case.EFFECTS, saturation.key, replace(saturation, ranges={
        'rail': lambda random, context: next(rails), 'knee': lambda random, context: 0.5}))
    monkeypatch.setitem(case.EFFECTS, contact.key, replace(contact, ranges={
        'gap': lambda random, context: 0.7 * context.stroke,
        'force': lambda random, context: 50.0, 'roughness': lambda random, context: 2e-7}))
    out = batch(tmp_path, hidden=[('two', (contact.key, saturation.key))])
    label = labels.reveal(out)['sets']['set_000']
    assert label['attempts'] == 2
    assert max(label['effects'][0]['over_noise_beside'].values()) > 1.0


def test_another_batch_in_the_same_folder_is_refused(tmp_path):
    """Two seeds never mix."""
    out = tmp_path / 'public'
    owner = labels.truth_folder(out) / 'batch.txt'
    owner.parent.mkdir(parents=True)
    owner.write_text('something else\n')
    with pytest.raises(InputError, match='another batch'):
        make.make(2, 1, out)


@pytest.mark.parametrize('arguments', [
    ['challenge', 'make', '--sets', '0', '--seed', '1', '--out', 'x'],
    ['challenge', 'answer', 'nowhere'],
    ['challenge', 'score', 'nowhere'],
])
def test_wrong_input_ends_with_status_2_and_one_line(arguments, capsys):
    """As every command of the package."""
    assert main(arguments) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_the_help_names_the_three_commands():
    """Make, answer, score."""
    shown = CliRunner().invoke(command, ['--help']).output
    assert all(name in shown for name in ('make', 'answer', 'score'))


def test_interrupted_making_goes_on_where_it_stopped(short, tmp_path, monkeypatch):
    """Finished sets are not made again, and the result is the same as in one go."""
    whole = make.make(3, 5, tmp_path / 'whole', jobs=1)
    counts = []

    def stop(done):
        counts.append(done)
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make.make(3, 5, tmp_path / 'parts', jobs=1, progress=stop)
    made = []
    really = make.make_set
    monkeypatch.setattr(make, 'make_set', lambda *task: made.append(task[1]) or really(*task))
    parts = make.make(3, 5, tmp_path / 'parts', jobs=1)
    assert made == [2]
    assert parts.read_bytes() == whole.read_bytes()


def test_a_set_whose_public_files_were_deleted_is_made_again(short, tmp_path):
    committed = make.make(1, 5, tmp_path / 'batch', jobs=1).read_bytes()
    shutil.rmtree(tmp_path / 'batch')
    assert make.make(1, 5, tmp_path / 'batch', jobs=1).read_bytes() == committed
    assert (tmp_path / 'batch' / 'devices' / 'set_000.yaml').is_file()
    assert list((tmp_path / 'batch' / 'set_000').glob('*.csv.gz'))


@pytest.mark.slow
def test_a_device_that_runs_away_is_drawn_again(tmp_path):
    """Of this seed a softening bow was drawn under which the stack finds no rest."""
    make.make_set(tmp_path / 'batch', 174, 113721972, 'one', ('asymmetric_hysteresis',))
    label = json.loads((labels.truth_folder(tmp_path / 'batch') / 'set_174.json').read_text())
    assert label['attempts'] > 1
    assert max(label['effects'][0]['over_noise'].values()) < 1e4
