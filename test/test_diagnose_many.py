# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Several devices at once: the same answers here, over processes and on a Dask cluster."""

from dataclasses import replace
import json
import os
from pathlib import Path
import shlex

from piezo_stack_sim.cli import main
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.gap.many import _is_done, diagnose_many, Job
from piezo_stack_sim.gap.write import inputs_of
from piezo_stack_sim.plant import Device
from piezo_stack_sim.plant.parameters import save_device
from piezo_stack_sim.recording import programmes, RecordingSet
from piezo_stack_sim.recording.write import write_csv_set
import pytest
from test_gap import measure


def answers(jobs):
    """Return each diagnosis.json, without where it lies and how long it took."""
    found = []
    for job in jobs:
        with open(f'{job.out}/diagnosis.json', encoding='utf-8') as file:
            found.append(json.load(file))
        del found[-1]['files'], found[-1]['how']['settings']['seconds']
        # Whoever gives that command gets the answer of the one device once more.
        told = shlex.split(found[-1]['how'].pop('command'))
        assert told == ['piezo_stack', 'diagnose', *job.paths, '--params', job.params,
                        '--out', job.out]
    return found


def test_a_dask_cluster_answers_what_processes_answer(tmp_path):
    distributed = pytest.importorskip('distributed')
    nominal = Device.nominal()
    save_device(nominal, tmp_path / 'nominal.yaml')
    devices = {'gain': nominal.with_effects({'amplifier_gain': {'gain_error': 0.02}}),
               'stiff': nominal.with_effects({'sensor_gain': {'gain_error': 0.1}})}
    push = programmes.force(cycles=1, rate=2e3)
    for name, device in devices.items():
        write_csv_set(RecordingSet(name, (measure(device, push, ('voltage', 'displacement'), 1),)),
                      tmp_path / name)

    def jobs(way):
        return [Job((str(tmp_path / name),), str(tmp_path / 'nominal.yaml'),
                    str(tmp_path / way / name)) for name in devices]

    here = [line for _, line in diagnose_many(jobs('here'), workers=2)]
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True,
                                  dashboard_address=None) as cluster:
        there = [line for _, line in diagnose_many(jobs('there'),
                                                   scheduler=cluster.scheduler_address)]
        again = [line for _, line in diagnose_many(jobs('there'),
                                                   scheduler=cluster.scheduler_address)]
    assert sorted(here) == sorted(there) and not any('failed' in line for line in here)
    assert answers(jobs('here')) == answers(jobs('there'))
    assert again == ['done before'] * len(devices)
    # What was recorded anew, and half an answer, are asked again.
    first, second = jobs('there')
    assert _is_done(first) and _is_done(second)
    later = os.stat(f'{first.out}/diagnosis.json').st_mtime + 5.0
    os.utime(next(Path(first.paths[0]).iterdir()), (later, later))
    Path(second.out, 'diagnosis.json').write_text(json.dumps({'inputs': inputs_of(
        second.paths, second.params)}), encoding='utf-8')
    assert not _is_done(first) and not _is_done(second)
    # What is there is not passed off as the answer to another question.
    with pytest.raises(InputError, match='made from other unit .*remove it'):
        next(diagnose_many([replace(jobs('there')[0], units=('displacement=um',))]))


@pytest.mark.parametrize('arguments, words', [
    (['a/bench', 'b/bench', '--jobs', '2'], ['--jobs 2', '--separate']),
    (['a/bench', '--scheduler', 'tcp://here:1'], ['--scheduler tcp://here:1', '--separate']),
    (['a/bench', 'b/bench', '--separate'], ['bench', 'different names']),
])
def test_what_cannot_be_meant_is_refused_before_anything_is_read(arguments, words, tmp_path,
                                                                 capsys):
    assert main(['diagnose', *arguments, '--params', 'nominal.yaml',
                 '--out', str(tmp_path / 'out')]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1 and all(word in said for word in words)
    assert not (tmp_path / 'out').exists()
