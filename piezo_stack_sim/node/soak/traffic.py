# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Faults of those who send: floods, silence, deaths, latecomers, rivals."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

from piezo_stack_sim.node.soak.probe import Probe
from piezo_stack_sim.node.soak.stage import Check, RATES, Stage

FLOOD = 10_000.0  # Hz


def flood(stage: Stage) -> list[Check]:
    """Send commands ten times as fast as the device ticks."""
    probe = stage.probe('wall')
    probe.fresh()
    before = probe.report()
    wanted = round(FLOOD * max(0.5, 3.0 * stage.scale))
    began, sent = time.monotonic(), 0
    while sent < wanted:
        due = min(wanted, int((time.monotonic() - began) * FLOOD) + 1)
        for sent in range(sent + 1, due + 1):
            probe.send('voltage_command', 30.0 + 20.0 * (sent % 2))
        probe.spin(0.0)
    rate = sent / (time.monotonic() - began)
    probe.send('voltage_command', 42.0)
    probe.wait(lambda: probe.heard['voltage'].last == 42.0, 'the last command of a flood')
    after = probe.report()
    return [
        Check('the last command of the flood rules',
              f'{sent:,} commands at {rate:,.0f} Hz, then 42 V: {after[2]["voltage"]} V',
              after[2]['voltage'] == '42'),
        stage.no_time_lost(before, after),
        Check('state finite', f'{probe.heard["displacement"].count:,} samples heard',
              probe.finite),
    ]


def silence(stage: Stage) -> list[Check]:
    """Fall silent until the watchdog notices, then send a burst."""
    probe = stage.probe('wall')
    probe.fresh()
    probe.set_parameters(command_timeout=0.2)
    probe.send('voltage_command', 35.0)
    told = probe.told(lambda _, v: v['command_timed_out'] == 'true')
    held = probe.heard['voltage'].last
    burst = stage.count(2000)
    for k in range(burst):
        probe.send('voltage_command', 10.0 + 50.0 * k / burst)
    probe.send('voltage_command', 55.0)
    probe.wait(lambda: probe.heard['voltage'].last == 55.0, 'the end of a burst')
    probe.set_parameters(command_timeout=0.0)
    calm = probe.told(lambda _, v: v['command_timed_out'] == 'false')
    return [
        Check('silence is reported, the command held', f'35 V held: {held:g} V',
              told and held == 35.0),
        Check('the newest of the burst rules, the report ends',
              f'{burst + 1} commands at once, then {probe.heard["voltage"].last:g} V',
              calm and probe.heard['voltage'].last == 55.0),
        Check('state finite', f'{probe.heard["displacement"].count:,} samples heard',
              probe.finite),
    ]


def _driver(topic: str, value: float, rate: float = 200.0) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, '-m', 'piezo_stack_sim.node.soak.publisher', topic, str(value),
         str(rate)], env=os.environ)


def deaths(stage: Stage) -> list[Check]:
    """Kill the driver in mid-sentence, again and again; another one takes over."""
    probe = stage.probe('wall')
    probe.fresh()
    before = probe.report()
    lives = stage.count(5)
    obeyed = held = 0
    for life in range(lives):
        value = 20.0 + 10.0 * life
        driver = _driver(f'{probe.device}/voltage_command', value)
        try:
            probe.wait(lambda: probe.heard['voltage'].last == value, 'the driver that returned')
            obeyed += 1
        finally:
            driver.send_signal(signal.SIGKILL)
            driver.wait()
        probe.listen(0.3)
        held += probe.heard['voltage'].last == value
    after = probe.report()
    return [
        Check('each driver that returns is obeyed', f'{obeyed} of {lives}', obeyed == lives),
        Check('after each death the last command is held', f'{held} of {lives}', held == lives),
        stage.no_time_lost(before, after),
        Check('state finite', f'{probe.heard["displacement"].count:,} samples heard',
              probe.finite),
    ]


def latecomers(stage: Stage) -> list[Check]:
    """Let clients join a device that has long been running, and leave again."""
    probe = stage.probe('wall')
    probe.fresh()
    probe.send('voltage_command', 33.0)
    probe.wait(lambda: probe.heard['voltage'].last == 33.0, 'the command')
    guests = stage.count(8)
    right = even = 0
    for number in range(guests):
        guest = Probe(probe.device, f'guest_{number}')
        try:
            guest.connect()
            guest.listen_to_stamps()
            guest.wait(lambda: len(guest.stamps) >= 50, 'samples for a latecomer')
            steps = sorted(b - a for a, b in zip(guest.stamps, guest.stamps[1:]))
            right += guest.heard['voltage'].last == 33.0
            even += abs(steps[len(steps) // 2] - 1.0 / RATES['wall']) < 2e-5
        finally:
            guest.close()
        probe.listen(0.05)
    return [
        Check('each hears the present state', f'{right} of {guests}', right == guests),
        Check('each hears evenly stamped samples', f'{even} of {guests}', even == guests),
        Check('state finite', f'{probe.heard["displacement"].count:,} samples heard',
              probe.finite),
    ]


def rivals(stage: Stage) -> list[Check]:
    """Let two drivers command one device at once."""
    probe = stage.probe('lockstep')
    rival = Probe(probe.device, 'rival', ('voltage',))
    try:
        rival.connect()
        probe.fresh()
        each = stage.count(2000)
        voltages = probe.heard['voltage']
        voltages.keep = True
        for k in range(each):
            probe.send('voltage_command', 20.0)
            rival.send('voltage_command', 70.0)
            probe.wait(lambda: voltages.count >= 2 * k - 400, 'samples')
        probe.wait(lambda: voltages.count >= 2 * each, 'a sample for each command')
        probe.listen(0.2)
        voltages.keep = False
        told = probe.told(lambda message, _: 'several publishers' in message)
    finally:
        rival.close()
    shares = [voltages.kept.count(value) for value in (20.0, 70.0)]
    alone = probe.told(lambda message, _: 'several publishers' not in message)
    return [
        Check('a sample for each command of either',
              f'{voltages.count:,} for {2 * each:,}, {shares[0]:,} and {shares[1]:,}',
              voltages.count == 2 * each and shares == [each, each]),
        Check('the rivalry is reported while it lasts', 'in /diagnostics', told and alone),
        Check('state finite', f'{voltages.count:,} samples heard', probe.finite),
    ]
