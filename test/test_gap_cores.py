# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Work spread over the cores: in order, without waiting for each other, none left at work."""

import threading

from piezo_stack_sim.gap import cores
from piezo_stack_sim.gap.cores import parallel
import pytest

PATIENCE = 20.0  # s; nobody who works together waits so long


@pytest.fixture
def crew(monkeypatch):
    """Return nothing; there are three cores, whatever the machine has."""
    with cores.ThreadPoolExecutor(20) as pool:
        monkeypatch.setattr(cores, '_POOL', pool)
        monkeypatch.setattr(cores, '_IDLE', threading.Semaphore(2))
        yield


def test_answers_come_in_the_order_of_the_items(crew):
    assert parallel(lambda i: i * i, range(100)) == [i * i for i in range(100)]
    assert parallel(str, []) == []


def test_three_work_at_the_same_time(crew):
    together = threading.Barrier(3, timeout=PATIENCE)
    assert sorted(parallel(lambda _: together.wait(), range(3))) == [0, 1, 2]


def test_who_has_nothing_left_to_do_helps_with_the_smaller_work_of_another(crew):
    """All three are needed inside of one item, as soon as the other items are done."""
    together = threading.Barrier(3, timeout=PATIENCE)
    others = threading.Semaphore(0)

    def outer(item):
        if item:
            others.release()
            return item
        for _ in range(2):
            assert others.acquire(timeout=PATIENCE)
        while cores._IDLE._value < 2:  # until both have said that they are idle
            pass
        return sum(parallel(lambda _: together.wait(), range(3)))

    assert parallel(outer, range(3)) == [3, 1, 2]


def test_work_within_work_within_work_comes_to_an_end(crew):
    def deep(level):
        return 1 if level == 0 else sum(parallel(deep, [level - 1] * 4))

    assert deep(4) == 256


def test_a_failure_is_told_and_ends_the_work(crew):
    begun = []

    def fails(i):
        begun.append(i)
        raise RuntimeError('no')

    with pytest.raises(RuntimeError, match='no'):
        parallel(fails, range(1000))
    assert len(begun) < 1000
    assert parallel(abs, [-1, -2, -3]) == [1, 2, 3]  # and everybody is there again


def test_one_core_does_all_by_itself(monkeypatch):
    monkeypatch.setattr(cores, '_IDLE', threading.Semaphore(0))
    assert set(parallel(lambda _: threading.get_ident(), range(5))) == {threading.get_ident()}
