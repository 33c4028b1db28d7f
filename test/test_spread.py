# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Work over processes: what is finished stays, and what fails fails alone."""

import json
import os
from pathlib import Path
import subprocess
import sys
import time

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.gap.many import diagnose_many, Job
from piezo_stack_sim.gap.write import inputs_of
from piezo_stack_sim.spread import spread
import pytest


def dies(folder, name):
    """End the worker process: for 'bad' at the first call only, for 'worse' at every one."""
    mark = folder / name
    if name == 'worse' or name == 'bad' and not mark.exists():
        mark.write_text('tried')
        os._exit(1)
    if name == 'wrong':
        raise ValueError('wrong')
    mark.write_text('done')
    return name


def test_a_worker_that_dies_costs_no_finished_work(tmp_path):
    names = ('a', 'bad', 'b', 'c')
    results = dict(spread(dies, [(tmp_path, name) for name in names], jobs=2))
    assert results == dict(enumerate(names))
    assert all((tmp_path / name).read_text() == 'done' for name in names)


def test_what_kills_every_worker_is_given_up_and_the_rest_is_done(tmp_path):
    names = ('worse', 'a', 'b', 'c')
    results = dict(spread(dies, [(tmp_path, name) for name in names], jobs=2))
    lost = [i for i, result in results.items() if isinstance(result, InputError)]
    assert 0 in lost and sorted(results) == [0, 1, 2, 3]
    assert all(results[i] == names[i] for i in results if i not in lost)


def test_an_error_is_the_result_of_its_piece_alone(tmp_path):
    for jobs in (1, 2):
        results = dict(spread(dies, [(tmp_path, 'wrong'), (tmp_path, 'a')], jobs=jobs))
        assert isinstance(results[0], ValueError) and results[1] == 'a'


def waits(folder, name):
    """Tell who works here, and go on working."""
    (folder / name).write_text(str(os.getpid()))
    time.sleep(600.0)


def is_alive(worker):
    """Tell whether a process is there and no zombie."""
    try:
        return Path(f'/proc/{worker}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except OSError:
        return False


@pytest.mark.skipif(not Path('/proc').is_dir(), reason='processes are looked up in /proc')
def test_no_worker_goes_on_when_its_parent_was_killed(tmp_path):
    code = ('from pathlib import Path; from piezo_stack_sim.spread import spread; '
            'from test_spread import waits; '
            f'list(spread(waits, [(Path("{tmp_path}"), name) for name in "ab"], jobs=2))')
    parent = subprocess.Popen([sys.executable, '-c', code], env={
        **os.environ, 'PYTHONPATH': os.pathsep.join([str(Path(__file__).parent), *sys.path])})
    end = time.monotonic() + 60.0
    while not all((tmp_path / name).is_file() and (tmp_path / name).read_text() for name in 'ab'):
        assert time.monotonic() < end and parent.poll() is None
        time.sleep(0.05)
    workers = [int((tmp_path / name).read_text()) for name in 'ab']
    assert all(map(is_alive, workers))
    parent.kill()
    parent.wait()
    while any(map(is_alive, workers)):
        assert time.monotonic() < end
        time.sleep(0.05)


def test_a_device_that_cannot_be_diagnosed_does_not_stop_the_others(tmp_path):
    done = tmp_path / 'done'
    done.mkdir()
    (done / 'diagnosis.json').write_text(json.dumps({
        'verdict': 'NO_GAP', 'inputs': inputs_of([str(done)], 'no.yaml')}))
    jobs = [Job((str(tmp_path / name),), 'no.yaml', str(tmp_path / name))
            for name in ('first', 'done', 'second')]
    lines = {job.out: line for job, line in diagnose_many(jobs, workers=2)}
    assert lines[str(done)] == 'done before'
    assert [line for line in lines.values() if line.startswith('failed: no.yaml')] == [
        lines[str(tmp_path / name)] for name in ('first', 'second')]
