# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Faults of those who control: clocks, stopped processes, parameters, services, extremes."""

from __future__ import annotations

from collections.abc import Callable
import math
import random
import signal

from piezo_stack_sim.node.soak.probe import Probe
from piezo_stack_sim.node.soak.stage import Check, RATES, Stage
from rosgraph_msgs.msg import Clock

JUMPS = (1_000, 10, 2_000_000_000, 0, 5_000)  # s, what a foreign /clock says, one after the other


def clock_by_wall(stage: Stage) -> list[Check]:
    """Make the device take its stamps from a foreign ``/clock`` that jumps."""
    probe = stage.probe('wall')
    probe.fresh()
    before = probe.report()
    foreign = probe.node.create_publisher(Clock, '/clock', 10)
    listener = Probe(probe.device, 'reader', ())
    followed = 0
    try:
        listener.listen_to_stamps()
        probe.set_parameters(use_sim_time=True)
        probe.wait(lambda: foreign.get_subscription_count() >= 1, 'the device at /clock')
        message = Clock()
        for jump in JUMPS:
            message.clock.sec = jump

            def followed_it() -> bool:
                foreign.publish(message)  # again and again: who reads a clock may miss a message
                return listener.stamps[-1:] == [float(jump)]

            listener.wait(followed_it, 'its stamp')
            followed += 1
    finally:
        probe.set_parameters(use_sim_time=False)
        probe.node.destroy_publisher(foreign)
        listener.close()
    probe.listen(0.1)
    after = probe.report()
    return [
        Check('stamps follow the clock, with use_sim_time',
              f'{followed} of {len(JUMPS)} jumps', followed == len(JUMPS)),
        stage.no_time_lost(before, after),
        Check('state finite', f'{probe.heard["displacement"].count:,} samples heard',
              probe.finite),
    ]


def clock_in_lockstep(stage: Stage) -> list[Check]:
    """Publish a second ``/clock`` beside that of the device."""
    probe = stage.probe('lockstep')
    foreign = probe.node.create_publisher(Clock, '/clock', 10)
    reader = Probe(probe.device, 'reader', ())
    count = stage.count(500)
    try:
        probe.wait(lambda: probe.node.count_publishers('/clock') >= 2, 'both clocks')
        reader.listen_to_stamps()
        reader.connect()
        reader.step_until_heard()
        probe.fresh()
        reader.listen(0.1)
        reader.forget()
        message = Clock()
        for k in range(count):
            message.clock.sec = JUMPS[k % len(JUMPS)]
            foreign.publish(message)
            probe.send('voltage_command', 0.1 * k % 60.0)
        reader.wait(lambda: len(reader.stamps) >= count, 'samples')
        told = probe.told(lambda message, _: 'somebody else publishes /clock' in message)
        steps = [b - a for a, b in zip(reader.stamps, reader.stamps[1:])]
    finally:
        probe.node.destroy_publisher(foreign)
        reader.close()
    wrong = sum(abs(step - 1.0 / RATES['lockstep']) > 1e-6 for step in steps)
    return [
        Check('stamps keep to device time', f'{wrong} of {len(steps)} steps wrong', not wrong),
        Check('the second clock is reported', 'in /diagnostics', told),
        Check('state finite', f'{count} ticks', probe.finite),
    ]


def stopped(stage: Stage) -> list[Check]:
    """Stop the process with SIGSTOP and let it go on."""
    device, probe = stage.device('wall'), stage.probe('wall')
    probe.fresh()
    probe.send('voltage_command', 50.0)
    probe.wait(lambda: probe.heard['voltage'].last == 50.0, 'the command')
    before = probe.report()
    pauses = [max(0.5, 2.0 * stage.scale), 0.05]
    for pause in pauses:
        device.process.send_signal(signal.SIGSTOP)
        probe.listen(pause)
        device.process.send_signal(signal.SIGCONT)
        probe.listen(0.3)
    after = probe.report(lambda _, v: int(v['late_ticks']) > int(before[2]['late_ticks']))
    late = int(after[2]['late_ticks']) - int(before[2]['late_ticks'])
    return [
        stage.no_time_lost(before, after),
        Check('the late ticks are reported', f'{late} late ticks for {sum(pauses):.2f} s stopped',
              late >= 0.9 * max(pauses) * RATES['wall']),
        Check('the command is still held', f'{after[2]["voltage"]} V',
              after[2]['voltage'] == '50'),
        Check('state finite', f'{probe.heard["displacement"].count:,} samples heard',
              probe.finite),
    ]


GOOD = (
    {'drive': 'charge'}, {'drive': 'voltage'}, {'drive': 'open'}, {'drive': 'shorted'},
    {'effects.leakage.resistance': 1e7}, {'effects.leakage.resistance': math.inf},
    {'effects.sensor_gain.gain_error': 0.1}, {'effects.sensor_gain.gain_error': 0.0},
    {'noise.displacement': 2e-9}, {'noise.displacement': 0.0}, {'command_timeout': 0.5},
    {'command_timeout': 0.0})
BAD = (
    {'drive': 'sideways'}, {'drive': 3}, {'rate': 17.0}, {'actuator.mass': -1.0},
    {'effects.creep.gain_per_decade': 0.02}, {'actuator.stiffness': math.nan},
    {'noise.displacement': -1.0}, {'nonsense': 1.0},
    {'command_timeout': math.inf, 'stepping': 'wall'}, {'effects.sensor_gain.gain_error': 1e30})


def parameters(stage: Stage) -> list[Check]:
    """Set parameters as fast as answers come, right and wrong ones, from two clients."""
    probe = stage.probe('lockstep')
    rival = Probe(probe.device, 'rival', ())
    chance, waiting = random.Random(1), []
    total = stage.count(1000)
    answers: list[tuple[bool, bool]] = []  # wanted, got

    def collect(limit: int) -> Callable[[], bool]:
        def done() -> bool:
            for client, wanted, future in list(waiting):
                client.spin()
                if future.done():
                    waiting.remove((client, wanted, future))
                    answers.append((wanted, all(r.successful for r in future.result().results)))
            return len(waiting) <= limit
        return done

    try:
        rival.connect()
        rival.introduce()
        probe.fresh()
        for k in range(total):
            good = chance.random() < 0.6
            client = chance.choice((probe, rival))
            waiting.append((client, good, client.ask_parameters(
                chance.choice(GOOD if good else BAD))))
            probe.send('voltage_command', 0.05 * (k % 1000))
            probe.send('external_force', -0.5 * (k % 100))
            probe.wait(collect(8), 'answers to parameters')
        probe.wait(collect(0), 'the last answers to parameters')
    finally:
        rival.close()
        back = probe.set_parameters(
            drive='voltage', command_timeout=0.0, noise__displacement=0.0,
            effects__leakage__resistance=math.inf, effects__sensor_gain__gain_error=0.0)
    wrong = sum(wanted != got for wanted, got in answers)
    return [
        Check('each is answered: right ones taken, wrong ones refused',
              f'{len(answers)} answers, {wrong} not as they should be',
              len(answers) == total and not wrong),
        Check('state finite', f'{probe.heard["displacement"].count:,} samples heard',
              probe.finite),
        Check('they can be set back', f'{sum(r.successful for r in back)} of {len(back)}',
              all(r.successful for r in back)),
    ]


def clients(stage: Stage) -> list[Check]:
    """Pause, step and reset the device from several clients at once."""
    probe = stage.probe('lockstep')
    probe.fresh()
    crowd = [Probe(probe.device, f'client_{k}', ()) for k in range(4)]
    chance = random.Random(2)
    calls = stage.count(300)
    answered, before = 0, probe.report()
    try:
        for client in crowd:
            client.connect()
            client.introduce()
        for _ in range(calls):
            futures = []
            for client in crowd:
                service = chance.choice(('pause', 'step', 'reset'))
                fields = {'data': chance.random() < 0.5} if service == 'pause' else {}
                futures.append(client.ask(service, **fields))
                client.send('voltage_command', chance.uniform(0.0, 100.0))

            def done() -> bool:
                for client in crowd:
                    client.spin()
                return all(future.done() for future in futures)

            probe.wait(done, 'answers to pause, step and reset')
            answered += sum(future.result() is not None for future in futures)
    finally:
        for client in crowd:
            client.close()
    probe.call('pause', data=False)
    after = probe.report(lambda _, v: v['paused'] == 'false')
    recovered = int(after[2]['recovered_states']) - int(before[2]['recovered_states'])
    return [
        Check('every call is answered', f'{answered:,} of {calls * len(crowd):,}',
              answered == calls * len(crowd)),
        Check('state finite', f'{recovered} states taken back', probe.finite and not recovered),
    ]


def extremes(stage: Stage) -> list[Check]:
    """Command what no stack bears: the whole range, far beyond it, and what is no number."""
    probe = stage.probe('lockstep')
    probe.fresh()
    before = probe.report()
    chance = random.Random(3)
    count = stage.count(2000)
    absurd = (1e3, -1e3, 1e300, -1e300, 5e-324, math.nan, math.inf, -math.inf)
    clamped = refused = steps = 0
    for drive, topic, high in (('voltage', 'voltage_command', 150.0),
                               ('charge', 'charge_command', 1.0)):
        probe.set_parameters(drive=drive)
        for k in range(count):
            value = chance.choice(absurd) if k % 10 == 0 else chance.uniform(0.0, high)
            force = chance.choice(absurd) if k % 10 == 5 else chance.uniform(-5e3, 5e3)
            low = 0.0 if drive == 'voltage' else -high
            clamped += (math.isfinite(value) and not low <= value <= high) + (
                math.isfinite(force) and abs(force) > 1e6)
            refused += (not math.isfinite(value)) + (not math.isfinite(force))
            steps += math.isfinite(value)
            probe.send('external_force', force)
            probe.send(topic, value)
            probe.wait(lambda: probe.heard['charge'].count >= steps - 200, 'samples')
    probe.wait(lambda: probe.heard['charge'].count >= steps, 'a sample for each command')
    after = probe.report()
    rise = {key: int(after[2][key]) - int(before[2][key])
            for key in ('clamped', 'refused_not_finite', 'recovered_states')}
    probe.set_parameters(drive='voltage')
    return [
        Check('state finite', f'{steps:,} steps, {rise["recovered_states"]} states taken back',
              probe.finite),
        Check('each number out of range is clamped and counted',
              f'{rise["clamped"]} of {clamped}', rise['clamped'] == clamped),
        Check('what is no number is refused and counted',
              f'{rise["refused_not_finite"]} of {refused}', rise['refused_not_finite'] == refused),
        Check('charge out of range is reported', after[2]['charge_out_of_range'],
              after[2]['charge_out_of_range'] == 'true'),
    ]
