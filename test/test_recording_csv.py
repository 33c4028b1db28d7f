# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""CSV files are read to the bit, written atomically, and every error names its place."""

import gzip
import os
import signal
import subprocess
import sys

from hypothesis import given, settings, strategies
import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording import (
    CsvWriter, parse_mapping, parse_units, read_csv, read_set, Recording, RecordingSet, write_csv,
    write_csv_set,
)
import pytest
from recorded import set_of, slow

GOOD = 'time,voltage_command,displacement\n0,0,0\n0.001,1,1e-7\n0.002,2,2.5e-7\n'
NUMBERS = strategies.floats(allow_nan=False, allow_infinity=False)


def written(tmp_path, text, name='run.csv'):
    """Write a file as it is and return its path."""
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def error(path, **options):
    """Return what reading complains about."""
    with pytest.raises(InputError) as caught:
        read_csv(path, **options)
    text = str(caught.value)
    assert text.startswith(str(path)) and '\n' not in text
    return text[len(str(path)):]


def test_columns_become_channels(tmp_path):
    recording = read_csv(written(tmp_path, GOOD))
    assert (recording.name, recording.drive, recording.has_force) == ('run', 'voltage', False)
    assert recording.command.tolist() == [0.0, 1.0, 2.0]
    assert recording.measured['displacement'].tolist() == [0.0, 1e-7, 2.5e-7]
    assert recording.rows.tolist() == [2, 3, 4]
    assert recording.external_force.tolist() == [0.0, 0.0, 0.0]
    assert not recording.findings


@pytest.mark.parametrize('text', [
    GOOD.replace('\n', '\r\n'),
    '\ufeff' + GOOD,
    GOOD.replace(',', ';'),
    GOOD.replace(',', '\t'),
    GOOD.replace(',', ' , '),
    GOOD.replace('time', '"Time"').replace('0.001', '"0.001"'),
    '\n# made by hand\n\n' + GOOD.replace('0.001', '\n0.001') + '\n\n',
    GOOD.replace('\n', ',an extra\n'),
], ids=['windows', 'mark', 'semicolon', 'tab', 'spaces', 'quotes', 'empty lines', 'extra column'])
def test_the_dialects_of_csv_say_the_same(tmp_path, text):
    recording = read_csv(written(tmp_path, text))
    assert recording.time.tolist() == [0.0, 0.001, 0.002]
    assert recording.measured['displacement'].tolist() == [0.0, 1e-7, 2.5e-7]


@given(rows=strategies.lists(strategies.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1))
@settings(max_examples=60, deadline=None)
def test_what_is_written_reads_back_to_the_bit(tmp_path_factory, rows):
    table = np.array(rows)
    recording = Recording('run', table[:, 0], 'charge', table[:, 1],
                          measured={'charge': table[:, 2]})
    for name in ('run.csv', 'run.csv.gz'):
        path = tmp_path_factory.mktemp('set') / name
        write_csv(recording, path)
        again = read_csv(path)
        assert again.drive == 'charge' and not again.findings
        for column, values in recording.columns().items():
            assert again.columns()[column].tobytes() == values.tobytes()


@given(cells=strategies.lists(strategies.one_of(
    NUMBERS.map(repr), strategies.sampled_from(
        ['', ' ', 'nan', 'NA', 'N/A', '-7', '+.5', '1e5', 'inf']),
    strategies.text(max_size=6).filter(lambda x: not {'\n', '\r'} & set(x))), min_size=3))
@settings(max_examples=200, deadline=None)
def test_a_cell_is_its_number_or_an_error(tmp_path_factory, cells):
    path = tmp_path_factory.mktemp('set') / 'run.csv'
    lines = [f'{k},0,{cell}' for k, cell in enumerate(cells)]
    path.write_bytes('\n'.join(['time,voltage_command,voltage', *lines, '']).encode())
    try:
        values = read_csv(path).measured['voltage']
    except InputError:
        return
    assert len(values) == len(cells)
    for cell, value in zip(cells, values):
        missing = cell.strip(' "').lower() in (
            '', 'nan', '-nan', '+nan', 'na', 'n/a', 'null', 'none')
        assert np.isnan(value) if missing else value == float(cell.strip(' "'))


@pytest.mark.parametrize('text', [
    GOOD.replace(',', ';').replace('.', ','),
    GOOD.replace(',', '\t').replace('.', ','),
    # With a date, which has points of its own, every cell is looked at.
    GOOD.replace(',', ';').replace('.', ',').replace('\n', ';26.11.2026\n'),
    GOOD.replace(',', ';').replace('.', ',').replace('1e-7', '"1e-7"'),
], ids=['semicolon', 'tab', 'date', 'quotes'])
def test_decimals_may_be_written_with_a_comma(tmp_path, text):
    recording = read_csv(written(tmp_path, text))
    assert recording.time.tolist() == [0.0, 0.001, 0.002]
    assert recording.measured['displacement'].tolist() == [0.0, 1e-7, 2.5e-7]
    assert ['decimals' in each.what for each in recording.findings] == [True]


@pytest.mark.parametrize('text', [
    'time;voltage_command;displacement\n0;0;0\n0,001;1;1e-7\n0.002;2;3e-7\n',
    'time;voltage_command;displacement\n0;0;0\n0.001;1;1e-7\n0;1,234;3e-7\n',
])
def test_decimals_are_written_in_one_way(tmp_path, text):
    assert error(written(tmp_path, text)).endswith(
        'is not a number: write all decimals with a point, and nothing between thousands')


@pytest.mark.parametrize('above', [
    'Operator;Smith\nDate;2024-01-02\n\n', '%date 2024\n', '# fine\nLab,A,B\n',
    'LabVIEW Measurement\t\nWriter_Version\t2\n***End_of_Header***\n'])
@pytest.mark.parametrize('mapping', [None, ['time=time']])
def test_lines_above_the_header_are_named_as_such(tmp_path, above, mapping):
    row = above.count('\n') + 1
    for good in (GOOD, GOOD.replace('time', 'X_Value'), GOOD.replace(',', ';')):
        wrong = error(written(tmp_path, above + good), mapping=parse_mapping(mapping))
        assert (f'the header seems to be row {row}: remove the lines above it, or begin each of '
                'them with #') in wrong
    read_csv(written(tmp_path, ''.join(f'# {line}\n' for line in above.split('\n')) + GOOD))


def test_a_first_line_of_one_cell_may_stand_above_the_header(tmp_path):
    wrong = error(written(tmp_path, 'measured today\nt,u,x\n0,1,2\n'))
    assert 'if its header stands below row 1, remove the lines above it' in wrong


@pytest.mark.parametrize('between, word', [
    (' ', 'spaces'), ('   ', 'spaces'), ('|', '|'), (' | ', '|')])
def test_another_separator_is_named(tmp_path, between, word):
    wrong = error(written(tmp_path, GOOD.replace(',', between)))
    assert f'separated by {word}: expected commas, semicolons or tabs' in wrong


def test_decimal_commas_between_commas_are_named(tmp_path):
    text = 'time,voltage_command,displacement\n0,0,0\n0,001,0,2,4e-09\n'
    wrong = error(written(tmp_path, text))
    assert wrong.startswith(': row 3: 5 cells, but the header has 3: if its decimals are written')
    assert 'semicolons or tabs' in wrong
    assert error(written(tmp_path, GOOD.replace('1e-7', '1e-7,4'))).endswith(
        'the header has 3: mend or remove the row')


def test_a_remark_in_brackets_costs_the_channel_but_not_the_recording(tmp_path):
    path = written(tmp_path, GOOD.replace('\n', ',7\n').replace('displacement,7', (
        'displacement,voltage (monitor)')))
    recording = read_csv(path)
    assert [*recording.measured] == ['displacement']
    assert any("'monitor' is no unit of voltage" in str(each) for each in recording.findings)
    assert 'voltage' in read_csv(path, units={'voltage': 1.0}).measured


def test_what_gave_a_unit_is_kept(tmp_path):
    path = written(tmp_path, GOOD.replace('displacement', 'displacement [um]').replace(
        'voltage_command', 'voltage_command [V]'))
    given = {'displacement': ('the header', 1e-6), 'voltage_command': ('the header', 1.0)}
    assert read_csv(path).stated == given
    assert read_csv(path, units={'displacement': 2.0}).stated == {
        **given, 'displacement': ('--unit', 2.0)}


def test_two_columns_of_one_name_are_told_apart_in_the_file(tmp_path):
    path = written(tmp_path, GOOD.replace('\n', ',7\n').replace('displacement,7', (
        'displacement,displacement')))
    for mapping in (None, parse_mapping(['displacement=displacement'])):
        assert error(path, mapping=mapping) == (
            ": columns 3 and 4 are both 'displacement': rename one in the file")
    path = written(tmp_path, GOOD.replace('\n', ',7\n').replace('displacement,7', (
        'displacement [um],displacement [m]')))
    assert "choose with --map 'displacement=displacement [um]'" in error(path)
    assert read_csv(path, parse_mapping(['displacement=displacement [um]'])).measured


@pytest.mark.parametrize('cell', ['2024-05-07T10:00:00.0', '10:00:00.5', '-', '07.05.2024'])
@pytest.mark.parametrize('delimiter', [',', ';'])
def test_a_time_that_is_not_a_number_is_expected_in_seconds(tmp_path, cell, delimiter):
    wrong = error(written(tmp_path, GOOD.replace('0.001', cell).replace(',', delimiter)))
    assert wrong.startswith(f": row 3, column 'time': '{cell}' is not a number: ")
    assert 'seconds' in wrong


def test_marks_between_thousands_are_not_taken_for_a_missing_value(tmp_path):
    assert error(written(tmp_path, GOOD.replace('1e-7', '"1,234.5"'))).endswith(
        'is not a number: write all decimals with a point, and nothing between thousands')


@pytest.mark.parametrize('cell', ['#N/A', 'OVERRANGE', '-', '---', 'O.L'])
@pytest.mark.parametrize('delimiter', [',', ';'])
def test_a_value_that_is_not_a_number_may_be_left_empty(tmp_path, cell, delimiter):
    text = GOOD.replace(',', delimiter)
    wrong = error(written(tmp_path, text.replace('1e-7', cell)))
    assert wrong == (f": row 3, column 'displacement': '{cell}' is not a number: expected a "
                     'number: leave the cell empty or write NaN if there is none')
    for mended in ('', 'NaN'):
        assert np.isnan(read_csv(
            written(tmp_path, text.replace('1e-7', mended))).measured['displacement'][1])


def test_a_row_of_units_may_follow_the_names(tmp_path):
    units = GOOD.replace('\n', '\n[ms],V,(um)\n', 1)
    recording = read_csv(written(tmp_path, units))
    assert recording.time == pytest.approx([0.0, 1e-6, 2e-6])
    assert recording.measured['displacement'] == pytest.approx([0.0, 1e-13, 2.5e-13])
    assert recording.rows.tolist() == [3, 4, 5]
    assert [each.what.split(': ')[-1] for each in recording.findings] == [
        'the header gives time in ms', 'the header gives displacement in um']
    # What --unit says counts, and what is no unit is no secret.
    assert read_csv(written(tmp_path, units), units=parse_units(['time=s'])).time[1] == 0.001
    wrong = error(written(tmp_path, units.replace('(um)', 'Volt')))
    assert wrong.startswith(": row 2: displacement: 'Volt' is no unit of it")
    assert wrong.endswith('--unit displacement=... overrules it')


def test_brackets_behind_a_mapped_column_give_its_unit(tmp_path):
    path = written(tmp_path, GOOD.replace('displacement', 'Weg [um]'))
    mapping = parse_mapping(['displacement=Weg [um]'])
    assert read_csv(path, mapping).measured['displacement'] == pytest.approx([0.0, 1e-13, 2.5e-13])
    path = written(tmp_path, GOOD.replace('displacement', 'Weg (Sensor)'))
    mapping = parse_mapping(['displacement=Weg (Sensor)'])
    assert read_csv(path, mapping).measured['displacement'].tolist() == [0.0, 1e-7, 2.5e-7]
    path = written(tmp_path, GOOD.replace('displacement', 'Weg [V]'))
    with pytest.raises(InputError, match="'Weg .V.': displacement: 'V' is no unit.*overrules"):
        read_csv(path, parse_mapping(['displacement=Weg [V]']))
    assert read_csv(path, parse_mapping(['displacement=Weg [V]']), parse_units(
        ['displacement=um'])).measured['displacement'][1] == pytest.approx(1e-13)


@pytest.mark.parametrize('header, factor', [
    ('displacement [microns]', 1e-6), ('displacement (Micrometers)', 1e-6),
    ('displacement_micron', 1e-6), ('displacement [Å]', 1e-10), ('displacement [A\u030a]', 1e-10),
    ('displacement [\u212b]', 1e-10), ('displacement [angstrom]', 1e-10), ('time [sec]', 1.0),
    ('time (seconds)', 1.0), ('time [min]', 60.0), ('time [h]', 3600.0), ('time [msec]', 1e-3),
    ('voltage_command [Volts]', 1.0), ('voltage_command [kilovolt]', 1e3)])
def test_common_words_are_units(tmp_path, header, factor):
    channel = header.replace('_micron', ' ').split()[0]
    read = read_csv(written(tmp_path, GOOD.replace(channel, header)))
    plain = read_csv(written(tmp_path, GOOD))
    assert read.columns()[channel] == pytest.approx(plain.columns()[channel] * factor)
    word = header.strip(')]').replace('_micron', ' micron').split()[-1].strip('([')
    assert parse_units([f'{channel}={word}']) == {channel: pytest.approx(factor)}


@pytest.mark.parametrize('channel', ['time', 'voltage_command', 'displacement'])
def test_a_channel_in_an_unknown_unit_is_named_and_mended_by_saying_which(tmp_path, channel):
    for word in ('Vpp', 'counts', '°', '2.5*um', '1e-6 m'):
        path = written(tmp_path, GOOD.replace(channel, f'{channel} [{word}]'))
        wrong = error(path)
        assert wrong.startswith(
            f": column '{channel} [{word}]': '{word}' is no unit of {channel} that is known")
        base = {'time': 's', 'voltage_command': 'V', 'displacement': 'm'}[channel]
        assert f'--unit {channel}=' in wrong and f'a factor to {base}' in wrong
        read = read_csv(path, units=parse_units([f'{channel}=m{base}'])).columns()[channel]
        assert read == pytest.approx(
            read_csv(written(tmp_path, GOOD, 'plain.csv')).columns()[channel] * 1e-3)


def test_what_is_behind_a_second_column_of_a_channel_is_its_own_affair(tmp_path):
    for name in ('displacement [raw]', 'displacement (2)'):
        path = written(tmp_path, GOOD.replace('\n', ',7\n').replace('displacement,7', (
            f'displacement,{name}')))
        assert read_csv(path).measured['displacement'].tolist() == [0.0, 1e-7, 2.5e-7]


@pytest.mark.parametrize('channel, name, factor', [
    ('displacement', 'displacement_um', 1e-6), ('displacement', 'Displacement (nm)', 1e-9),
    ('voltage_command', 'voltage_command_mV', 1e-3), ('voltage_command', 'voltage_mV', 1e-3),
    ('time', 'time_ms', 1e-3)])
def test_a_mapped_column_keeps_the_unit_of_its_own_name(tmp_path, channel, name, factor):
    path = written(tmp_path, GOOD.replace(channel, name))
    mapping = parse_mapping([f'{channel}={name}'])
    read, plain = (read_csv(each, which) for each, which in (
        (path, mapping), (written(tmp_path, GOOD, 'plain.csv'), None)))
    assert read.columns()[channel] == pytest.approx(plain.columns()[channel] * factor)
    assert any(f'the header gives {channel} in' in str(each) for each in read.findings)
    said = read_csv(path, mapping, parse_units([f'{channel}=2']))
    assert said.columns()[channel] == pytest.approx(plain.columns()[channel] * 2.0)


@pytest.mark.parametrize('unit', ['kg', 'g', 'kgf', 'gf', 'lbf', 'in', 'mil', '%'])
def test_a_unit_outside_the_si_is_refused_behind_a_mapped_column(tmp_path, unit):
    path = written(tmp_path, GOOD.replace('displacement', f'cell [{unit}]'))
    for channel, base in (('external_force', 'N'), ('displacement', 'm')):
        mapping = parse_mapping([f'{channel}=cell [{unit}]'])
        with pytest.raises(InputError, match=f'is no unit of it: expected {base} .*overrules'):
            read_csv(path, mapping)
        assert read_csv(path, mapping, parse_units([f'{channel}=2']))


def test_a_word_in_brackets_that_may_be_no_unit_is_noted(tmp_path):
    for word, noted in (('Sensor', True), ('Mikrometer', True), ('2', False)):
        path = written(tmp_path, GOOD.replace('displacement', f'Weg ({word})'))
        findings = [str(each) for each in
                    read_csv(path, parse_mapping([f'displacement=Weg ({word})'])).findings]
        assert [f'{word} is taken for no unit' in each for each in findings] == [True] * noted


def test_the_volts_of_a_sensor_are_no_contradiction_to_an_arbitrary_displacement(tmp_path):
    path = written(tmp_path, GOOD.replace('displacement', 'Weg [V]'))
    recording = read_set(path, ['displacement=Weg [V]'], ['displacement=arbitrary'])['run']
    assert recording.arbitrary
    assert recording.measured['displacement'].tolist() == [0.0, 1e-7, 2.5e-7]


@pytest.mark.parametrize('text, complaint', [
    ('# drive: open\n' + GOOD, ': the file says drive open, but voltage_command commands'),
    ('# drive: charge\n' + GOOD, ': the file says drive charge, but voltage_command commands'),
    ('# drive: charge\ntime,voltage_command\n0,0\n1,0\n',
     ': no charge_command: map one (--map charge_command=...), or, correct what it says'),
    ('# drive: open\n# drive: shorted\ntime,displacement\n0,0\n', ': row 2: drive shorted, after'),
])
def test_a_drive_that_contradicts_the_columns_is_refused(tmp_path, text, complaint):
    assert error(written(tmp_path, text)).startswith(complaint)


def test_a_command_that_is_zero_contradicts_no_drive(tmp_path):
    text = '# drive: open\n# drive: open\ntime,voltage_command,displacement\n0,0,0\n1,,1e-6\n'
    assert read_csv(written(tmp_path, text)).drive == 'open'


def test_a_minus_of_typography_is_shown_as_it_is_written(tmp_path):
    text = error(written(tmp_path, GOOD.replace('1e-7', '\u22125')))
    assert text.startswith(": row 3, column 'displacement': '\u22125' is not a number: write its")


def test_what_a_spreadsheet_writes_above_the_header_is_passed_over(tmp_path):
    path = written(tmp_path, 'sep=;\r\n' + GOOD.replace(',', ';').replace('\n', '\r\n'))
    assert read_csv(path).time.tolist() == read_csv(written(tmp_path, GOOD, 'b.csv')).time.tolist()


@pytest.mark.parametrize('name, channel', [
    ('external_force(N)', 'external_force'), ('voltage_command(V)', 'command')])
def test_a_unit_in_brackets_needs_no_blank_before_it(name, channel, tmp_path):
    text = 'time,voltage_command,external_force,displacement\n0,1,2,0\n0.1,2,3,1e-6\n'
    path = written(tmp_path, text.replace(name.partition('(')[0], name))
    assert getattr(read_csv(path), channel).tolist() == getattr(
        read_csv(written(tmp_path, text)), channel).tolist()


@pytest.mark.parametrize('text, complaint', [
    ('', ': empty'),
    ('\n\n# nothing\n', ': empty'),
    ('time,voltage_command\n', ': no rows'),
    ('0,1,2\n1,2,3\n', ': row 1: numbers where the names of the columns should be'),
    (GOOD.replace('1e-7', 'x'), ": row 3, column 'displacement': 'x' is not a number"),
    (GOOD.replace('1e-7', '1_0'), ": row 3, column 'displacement': '1_0' is not a number"),
    (GOOD.replace('1e-7', '٣'), ": row 3, column 'displacement'"),
    (GOOD.replace(',', ';').replace('0.002', '0,002'), ": row 4, column 'time': '0,002' is not a "
     'number: write all decimals with a point'),
    (GOOD.replace('1e-7', '1e-7,4'), ': row 3: 4 cells, but the header has 3'),
    (GOOD.replace('1,1e-7', '1'), ': row 3: 2 cells, but the header has 3'),
    (GOOD.replace('time', 'tiem'), ": no column \"time\" (did you mean 'tiem'?)"),
    (GOOD.replace('voltage_command', 'u'), ': no column "voltage_command" or "charge_command"'),
    (GOOD.replace('voltage_command', 'voltage_cmd'), ': no column "voltage_command" or '
     '"charge_command" (did you mean \'voltage_cmd\'?): map it (--map voltage_command=...)'),
    (GOOD.replace('voltage_command', 'voltage'), ': no column "voltage_command" or '
     '"charge_command": map it (--map voltage_command=...); '
     '--map voltage_command=voltage plays the voltage that was measured'),
    (GOOD.replace('displacement', 'time'), ": columns 1 and 3 are both 'time'"),
    (GOOD.encode('utf-16'), ': not UTF-8'),
    (GOOD.replace('time', 'zeit\xe4').encode('latin-1'), ': row 1: not UTF-8'),
    (b'PK\x03\x04\0\0\0\0', ': not UTF-8'),
    ('# drive: sideways\n' + GOOD, ": drive: 'sideways': expected one of"),
    (GOOD.replace('\n', '\r'), ': its lines end with CR alone, expected LF or CR LF'),
    ('x' * 2_000_000, ': a line of more than 1 MB'),
    (GOOD.replace('0.001', '"0.001'), ': row 3'),
    (GOOD.replace('displacement', 'charge_command').replace('\n0,0,0', '\n0,1,1'),
     ': both voltage_command and charge_command command something'),
])
def test_what_is_wrong_is_named_with_its_place(tmp_path, text, complaint):
    assert error(written(tmp_path, text)).startswith(complaint)


def test_a_file_that_is_not_there_is_named(tmp_path):
    assert error(tmp_path / 'no.csv') == ': cannot be read: No such file or directory'


def test_a_damaged_gzip_is_an_input_error(tmp_path):
    packed = gzip.compress(GOOD.encode() * 50)
    assert 'gzip' in error(written(tmp_path, packed[:-12], 'cut.csv.gz'))
    assert 'gzip' in error(written(tmp_path, packed[:20] + b'\xff' * 20, 'bad.csv.gz'))
    assert 'not gzipped' in error(written(tmp_path, GOOD, 'plain.csv.gz'))
    assert 'empty' in error(written(tmp_path, '', 'empty.csv.gz'))


def test_a_packed_file_is_known_by_its_bytes(tmp_path):
    assert len(read_csv(written(tmp_path, gzip.compress(GOOD.encode()), 'run.csv'))) == 3


def test_a_last_row_without_an_end_is_left_out_with_a_word(tmp_path):
    recording = read_csv(written(tmp_path, GOOD[:-4]))
    assert recording.time.tolist() == [0.0, 0.001]
    assert 'row 4: the last row has no line end' in str(recording.findings[0])


def test_a_large_file_is_thinned_out_with_a_word(tmp_path):
    rows = ''.join(f'{k},{k},{k}\n' for k in range(1000))
    path = written(tmp_path, 'time,voltage_command,voltage\n' + rows)
    recording = read_csv(path, max_values=900)
    assert recording.time.tolist() == list(range(0, 1000, 4))
    assert recording.rows.tolist() == list(range(2, 1002, 4))
    assert 'one row in 4 was kept' in str(recording.findings[0])
    # What was measured at the kept row, and the mean of the commands until the next.
    assert recording.measured['voltage'].tolist() == list(range(0, 1000, 4))
    assert recording.command.tolist() == [k + 1.5 for k in range(0, 1000, 4)]


def test_a_file_thinned_out_over_many_blocks_keeps_means_and_rows(tmp_path):
    count = 300_001
    rows = ''.join(f'{k},{k % 7},{k}\n' for k in range(count))
    path = written(tmp_path, 'time,voltage_command,voltage\n' + rows)
    recording = read_csv(path, max_values=200_000)
    step = 8
    assert recording.time.tolist() == list(range(0, count, step))
    commands = np.arange(count) % 7
    assert recording.command[-1] == commands[-1]
    assert recording.command[:-1] == pytest.approx(
        commands[:-1].reshape(-1, step).mean(axis=1))
    assert recording.rows.tolist() == list(range(2, count + 2, step))


def test_a_step_in_a_row_that_was_dropped_acts_as_long_as_it_did(tmp_path):
    rows = ''.join(f'{k},{10 * (k >= 501)},0\n' for k in range(1000))
    recording = read_csv(written(tmp_path, 'time,voltage_command,voltage\n' + rows),
                         max_values=900)
    assert recording.command[124:128].tolist() == [0.0, 7.5, 10.0, 10.0]


def test_a_file_longer_than_a_block_is_read_whole(tmp_path):
    rows = ''.join(f'{k},{k}.000000000000000,{-k}\n' for k in range(200_000))
    recording = read_csv(written(tmp_path, 'time,voltage_command,voltage\n' + rows))
    assert np.array_equal(recording.time, np.arange(200_000))
    assert np.array_equal(recording.measured['voltage'], -np.arange(200_000.0))
    assert recording.rows[-1] == 200_001


def test_an_error_far_into_the_file_has_the_right_row(tmp_path):
    rows = ''.join(f'{k},0.000000000000000,{k}\n' for k in range(200_000)).replace(
        '\n150000,', '\n\n150000x,')
    text = error(written(tmp_path, 'time,voltage_command,voltage\n' + rows))
    assert text.startswith(": row 150003, column 'time': '150000x'")


def test_names_and_units_are_mapped(tmp_path):
    path = written(tmp_path, 'ms,u,stage\n0,0,0\n1,0.5,-0.1\n2,1,-0.25\n')
    recording = read_csv(
        path, parse_mapping(['time=ms', 'voltage_command=u', 'displacement=stage']),
        parse_units(['time=ms', 'voltage_command=20', 'displacement=-um']))
    assert recording.time.tolist() == [0.0, 0.001, 0.002]
    assert recording.command.tolist() == [0.0, 10.0, 20.0]
    assert np.allclose(recording.measured['displacement'], [0.0, 1e-7, 2.5e-7])
    assert all('--unit' in str(each) for each in recording.findings)


@pytest.mark.parametrize('header', ['displacement [um]', 'displacement_um', 'Displacement (µm)'])
def test_a_unit_in_the_header_is_understood_and_noted(tmp_path, header):
    recording = read_csv(written(tmp_path, GOOD.replace('displacement', header)))
    assert np.allclose(recording.measured['displacement'], [0.0, 1e-13, 2.5e-13])
    assert 'the header gives displacement in' in str(recording.findings[0])


def test_a_mapped_column_that_is_missing_is_named_with_a_suggestion(tmp_path):
    path = written(tmp_path, GOOD.replace('displacement', 'stage_um'))
    text = error(path, mapping=parse_mapping(['displacement=stage_mm']))
    assert "no column 'stage_mm' (did you mean 'stage_um'?)" in text


def test_a_misspelt_column_is_not_passed_over_in_silence(tmp_path):
    recording = read_csv(written(tmp_path, GOOD.replace('displacement', 'displacment')))
    assert "'displacment': not used (did you mean 'displacement'?)" in str(recording.findings[0])


def test_a_second_command_that_is_zero_is_noted(tmp_path):
    recording = read_csv(written(tmp_path, GOOD.replace('displacement', 'charge_command').replace(
        '1e-7', '0').replace('2.5e-7', '0')))
    assert recording.drive == 'voltage'
    assert 'charge_command is zero throughout' in str(recording.findings[0])


@pytest.mark.parametrize('drive', ['voltage', 'charge', 'open', 'shorted'])
def test_every_drive_survives_the_file(tmp_path, drive):
    recording = slow().replace(drive=drive, external_force=np.arange(3000.0), has_force=True)
    write_csv(recording, tmp_path / 'run.csv.gz')
    again = read_csv(tmp_path / 'run.csv.gz')
    assert again.drive == drive
    assert all(np.array_equal(values, again.columns()[name])
               for name, values in recording.columns().items())


def test_equal_recordings_give_equal_files(tmp_path):
    for folder in ('a', 'b'):
        write_csv_set(set_of(slow()), tmp_path / folder)
    assert (tmp_path / 'a/triangle.csv.gz').read_bytes() == \
        (tmp_path / 'b/triangle.csv.gz').read_bytes()


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    write_csv(slow(), tmp_path / 'run.csv')
    before = (tmp_path / 'run.csv').read_bytes()

    def full(*_):
        raise OSError(28, 'No space left on device')
    monkeypatch.setattr(os, 'replace', full)
    with pytest.raises(InputError, match='No space left on device'):
        write_csv(slow(height=20.0), tmp_path / 'run.csv')
    assert (tmp_path / 'run.csv').read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == ['run.csv']


@pytest.mark.parametrize('name', ['../up', '', '.hidden', 'a/b', 'line\nend'])
def test_a_name_that_is_no_file_name_is_refused(tmp_path, name):
    with pytest.raises(InputError, match='not usable as a file name'):
        write_csv_set(set_of(slow(name=name)), tmp_path / 'set')
    assert not (tmp_path / 'set').exists()


def test_a_set_is_not_written_beside_an_older_one_with_the_other_ending(tmp_path):
    write_csv_set(set_of(slow()), tmp_path, packed=False)
    with pytest.raises(InputError, match='is in the way of'):
        write_csv_set(set_of(slow()), tmp_path, packed=True)


def test_a_set_with_two_recordings_of_one_name_is_refused():
    with pytest.raises(InputError, match='two recordings are called'):
        RecordingSet('device', (slow(), slow()))


def test_a_live_recording_can_be_read_at_any_time(tmp_path):
    with CsvWriter(tmp_path / 'run.csv', ['time', 'voltage_command', 'voltage']) as writer:
        for k in range(30):
            writer.write([k * 1e-3, k, 0.1 * k])
            assert len(read_csv(tmp_path / 'run.csv')) == k + 1
    with pytest.raises(InputError, match='exists already'):
        CsvWriter(tmp_path / 'run.csv', ['time', 'voltage_command'])


def test_every_prefix_of_a_live_recording_gives_its_whole_rows(tmp_path):
    with CsvWriter(tmp_path / 'run.csv', ['time', 'charge_command']) as writer:
        writer.write(np.column_stack([np.arange(5.0), np.pi * np.arange(5.0)]))
    text = (tmp_path / 'run.csv').read_bytes()
    header = text.index(b'\n') + 1
    for cut in range(header, len(text) + 1):
        path = written(tmp_path, text[:cut], 'cut.csv')
        whole = text[:cut].count(b'\n') - 1
        if not whole:
            assert error(path).startswith(': no rows')
            continue
        assert np.array_equal(read_csv(path).command, np.pi * np.arange(float(whole)))


@pytest.mark.skipif(not hasattr(signal, 'SIGKILL'), reason='needs SIGKILL')
def test_a_killed_recorder_loses_no_whole_row(tmp_path):
    program = (
        'import sys\n'
        'from piezo_stack_sim.recording.write import CsvWriter\n'
        f'writer = CsvWriter({str(tmp_path / "run.csv")!r}, ["time", "voltage_command"])\n'
        'k = 0\n'
        'while True:\n'
        '    writer.write([k * 1e-3, k / 3.0]); k += 1\n'
        '    if k % 100 == 0: print(k, flush=True)\n')
    process = subprocess.Popen([sys.executable, '-c', program], stdout=subprocess.PIPE, text=True)
    for _ in range(5):
        promised = int(process.stdout.readline())
    process.kill()
    process.communicate()
    recording = read_csv(tmp_path / 'run.csv')
    assert len(recording) >= promised
    assert np.array_equal(recording.command, np.arange(len(recording)) / 3.0)


def test_a_disk_that_runs_full_leaves_whole_rows(tmp_path, monkeypatch):
    writer = CsvWriter(tmp_path / 'run.csv', ['time', 'voltage_command'])
    writer.write([0.0, 1.0])
    real = os.write

    def full(file, data):
        if len(data) <= 3:
            raise OSError(28, 'No space left on device')
        return real(file, data[:len(data) - 3])
    monkeypatch.setattr(os, 'write', full)
    with pytest.raises(InputError, match='No space left'):
        writer.write([0.001, 2.0])
    monkeypatch.setattr(os, 'write', real)
    with pytest.raises(InputError, match='closed'):
        writer.write([0.002, 3.0])
    assert read_csv(tmp_path / 'run.csv').time.tolist() == [0.0]
