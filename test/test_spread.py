# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Work over processes: what is finished stays, and what fails fails alone."""

import json
import os

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.gap.many import diagnose_many, Job
from piezo_stack_sim.gap.write import inputs_of
from piezo_stack_sim.spread import spread


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


def test_a_device_that_cannot_be_diagnosed_does_not_stop_the_others(tmp_path):
    done = tmp_path / 'done'
    done.mkdir()
    (done / 'diagnosis.json').write_text(json.dumps({'inputs': inputs_of([str(done)], 'no.yaml')}))
    jobs = [Job((str(tmp_path / name),), 'no.yaml', str(tmp_path / name))
            for name in ('first', 'done', 'second')]
    lines = {job.out: line for job, line in diagnose_many(jobs, workers=2)}
    assert lines[str(done)] == 'done before'
    assert [line for line in lines.values() if line.startswith('failed: no.yaml')] == [
        lines[str(tmp_path / name)] for name in ('first', 'second')]
