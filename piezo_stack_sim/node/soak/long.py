# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The long runs: an hour of device time in lockstep, ten minutes by wall time."""

from __future__ import annotations

import math
import time

import numpy as np
from piezo_stack_sim.node.soak.probe import Probe
from piezo_stack_sim.node.soak.stage import Check, FLAT, RATES, Stage

AHEAD = 400  # commands on their way at once; the topics keep 1000
CHUNK = 10_000  # ticks compared with the offline simulation at once


def _flat(readings: list[int]) -> Check:
    """Judge readings of memory: the last tenth against the second."""
    tenth = max(1, len(readings) // 10)
    early, late = (float(np.median(part)) for part in (
        readings[tenth:2 * tenth] or readings[:1], readings[-tenth:]))
    grown = late - early
    return Check('memory is flat', f'{early / 2**20:.1f} MiB early, {grown / 2**10:+.0f} KiB late',
                 grown <= FLAT)


def _command(k: np.ndarray) -> np.ndarray:
    """Return a triangle of changing height with a fast ripple on it, in the printed range (V)."""
    phase = (k % 2000) / 2000.0
    height = 40.0 + 40.0 * np.sin(2e-6 * k) ** 2
    return height * (1.0 - np.abs(2.0 * phase - 1.0)) + 5.0 * (1.0 + np.sin(0.9 * k))


def hour(stage: Stage) -> list[Check]:
    """Drive the device in lockstep, as fast as it goes, each sample compared."""
    device, probe = stage.device('lockstep'), stage.probe('lockstep')
    total = round(stage.device_time * RATES['lockstep'])
    probe.fresh()
    displacement, charge = probe.heard['displacement'], probe.heard['charge']
    displacement.keep = charge.keep = True
    plant, memory, different, largest, charges = stage.plant('lockstep'), [], 0, 0.0, 0.0
    began = time.monotonic()
    for start in range(0, total, CHUNK):
        numbers = np.arange(start, min(start + CHUNK, total))
        commands = _command(numbers)
        _send_all(probe, commands.tolist(), int(start))
        wanted = plant.run(commands, np.zeros(commands.size))
        got = np.array(displacement.kept), np.array(charge.kept)
        different += int(np.sum(got[0] != wanted.displacement) + np.sum(got[1] != wanted.charge))
        largest = max(largest, float(np.max(np.abs(got[0] - wanted.displacement))))
        charges = max(charges, float(np.max(np.abs(got[1]))))
        displacement.kept.clear()
        charge.kept.clear()
        memory.append(device.memory())
        stage.progress((start + commands.size) / total)
    elapsed = time.monotonic() - began
    probe.listen(0.5)
    return [
        Check('a sample for each command, none twice',
              f'{displacement.count:,} of {total:,}, '
              f'{stage.device_time / elapsed:.1f} times real time',
              displacement.count == total == charge.count),
        Check('state finite', f'charge up to {1e6 * charges:.0f} µC', probe.finite),
        Check('every sample equals the offline simulation to the bit',
              f'{different} differ, by {1e9 * largest:.3g} nm at most', different == 0),
        _flat(memory),
    ]


def _send_all(probe: Probe, commands: list[float], done: int) -> None:
    topics = [probe.heard[name] for name in ('displacement', 'charge')]

    def wait_for(count: int) -> None:
        probe.wait(lambda: min(topic.count for topic in topics) >= count, f'sample {count}')

    for start in range(0, len(commands), AHEAD // 2):
        # The device works on one half of what is on its way while the other half is sent.
        wait_for(done + start - AHEAD // 2)
        for command in commands[start:start + AHEAD // 2]:
            probe.send('voltage_command', command)
    wait_for(done + len(commands))


def wall(stage: Stage) -> list[Check]:
    """Command the device by wall time at 100 Hz, as a slow controller does."""
    device, probe = stage.device('wall'), stage.probe('wall')
    probe.fresh()
    before = probe.report()
    count, memory = probe.heard['displacement'].count, []
    began = time.monotonic()
    end = began + stage.wall_time
    asked = began
    while (now := time.monotonic()) < end:
        probe.send('voltage_command', 45.0 - 45.0 * math.cos(2.0 * math.pi * (now - began)))
        probe.listen(0.01)
        if now > asked:
            memory.append(device.memory())
            asked = now + max(0.1, stage.wall_time / 100.0)
            stage.progress((now - began) / stage.wall_time)
    after = probe.report()
    ticks = int(after[2]['ticks']) - int(before[2]['ticks'])
    late = int(after[2]['late_ticks']) - int(before[2]['late_ticks'])
    tardy = int(after[2]['ticks_over_half_ms']) - int(before[2]['ticks_over_half_ms'])
    heard = probe.heard['displacement'].count - count
    return [
        stage.no_time_lost(before, after),
        Check('state finite', f'{heard:,} samples heard', probe.finite and heard > 0),
        Check('late ticks are counted, none left out',
              f'{ticks:,} ticks, {late} late by a period, {tardy} by 0.5 ms', ticks > 0),
        _flat(memory),
    ]
