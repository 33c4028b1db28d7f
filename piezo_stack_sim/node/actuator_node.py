# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""One virtual actuator as a ROS 2 node: topics, services and parameters around a plant."""

from __future__ import annotations

from dataclasses import replace
import time
from typing import cast

from diagnostic_msgs.msg import DiagnosticArray
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.node.commands import CommandIntake, News, Watchdog
from piezo_stack_sim.node.diagnostics import Findings
from piezo_stack_sim.node.messages import ClockTopic, FloatTopic, StateTopic
from piezo_stack_sim.node.parameters import DeviceParameters
from piezo_stack_sim.node.schedule import day_ahead, Schedule, SECOND
from piezo_stack_sim.node.simulation_clock import SimulationClock
from piezo_stack_sim.plant import Plant, Sample
from piezo_stack_sim.plant.compilation import compile_needed, is_bare, is_compiled
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import ROSClock
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

NAME = 'piezo_stack_node'
OUTPUTS = ('displacement', 'charge', 'force', 'voltage')
# Nothing may be lost between two ends in lockstep, whatever is sent at once.
DEPTH = {'wall': 10, 'lockstep': 1000}
# A backlog up to this many ticks is published tick by tick; of a longer one only the end.
SHORT_BACKLOG = 100
CHUNK = 5000  # ticks caught up at once, so that the node goes on listening


class ActuatorNode(Node):
    """
    The virtual device.

    In ``wall`` stepping the main loop calls `tick` at each deadline of
    `schedule`. A command is taken over at the tick after it, as by the input
    register of a converter, and acts from there; the sample of each tick is
    taken just before. In ``lockstep`` time stands still until a command, or a
    call of ``~/step``, advances it by one period; the force then acts together
    with the command that follows it. With leads open or shorted no command
    acts, and each force advances the time instead.

    Parameters
    ----------
    clock : SimulationClock
        The ``/clock`` that it shares with the other devices of the process.
    namespace : str
        ROS namespace.
    files : list of str
        Parameter files it was given, for error messages.
    bare_files : bool
        Whether nothing besides the files set a parameter.
    cli_args : list of str
        ROS arguments for this node alone.

    Raises
    ------
    InputError
        If a parameter is wrong.

    """

    def __init__(self, clock: SimulationClock, namespace: str = '',
                 files: list[str] | None = None, bare_files: bool = True,
                 cli_args: list[str] | None = None) -> None:
        super().__init__(NAME, namespace=namespace, cli_args=cli_args)
        try:
            self._parameter_table = DeviceParameters(self, files or [], bare_files)
            self._build(clock)
            self._parameter_table.check_all_used()
        except BaseException:
            self.destroy_node()
            raise
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)

    def _build(self, clock: SimulationClock) -> None:
        device = self._parameter_table.device
        compile_needed(device)
        self.plant = Plant(device)
        self.schedule = Schedule(device.rate)
        self.lockstep = device.stepping == 'lockstep'
        self.paused = False
        self.intake = CommandIntake(device.drive, device.actuator.voltage_range)
        self.watchdog = Watchdog(device.command_timeout, device.rate)
        self.last_sample = self.plant.sample()
        self._last_good = self.plant.state
        self._failures = 0
        self._ticks = 0  # device time in periods
        self._stamp = 0  # ns, of the newest tick
        self._rate = device.rate
        self._active: tuple[float | None, float] = (None, 0.0)
        self._failed_at: int | None = None
        self._known_failures = self._known_late = self._known_namesakes = 0
        self._ros_clock = cast(ROSClock, self.get_clock())
        self._news = News(self.intake.tally, self.get_logger().warning)
        self._clock_group = clock
        self._connect(device.joint_name)

    def _connect(self, joint: str) -> None:
        qos = QoSProfile(depth=DEPTH['lockstep' if self.lockstep else 'wall'])

        def publisher(kind, name, profile=qos):
            return self.create_publisher(
                kind, name, profile,
                qos_overriding_options=QoSOverridingOptions.with_default_policies())

        def subscribe(name, callback):
            return self.create_subscription(
                Float64, name, callback, qos,
                qos_overriding_options=QoSOverridingOptions.with_default_policies())

        self._displacement, self._charge, self._force, self._voltage = (
            FloatTopic(publisher(Float64, f'~/{name}')) for name in OUTPUTS)
        self._state = StateTopic(publisher(JointState, '~/state'), joint)
        self._diagnostics = publisher(DiagnosticArray, '/diagnostics', QoSProfile(depth=10))
        if self.lockstep:
            topic = None
            if not self._clock_group.has_topic:
                topic = ClockTopic(publisher(Clock, '/clock', QoSProfile(depth=10)))
            self._clock_group.join(self.get_fully_qualified_name(), topic)
        # The force comes first: an executor that polls takes it before a command sent after it.
        subscribe('~/external_force', self._on_force)
        self._command_inputs = [
            subscribe('~/voltage_command', lambda message: self._on_command('voltage', message)),
            subscribe('~/charge_command', lambda message: self._on_command('charge', message))]
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(Trigger, '~/step', self._on_step)
        self.create_service(SetBool, '~/pause', self._on_pause)

    # -- time --------------------------------------------------------------------

    def start(self, origin: int | None = None) -> None:
        """Begin to keep time from `origin` (ns), unless it is kept by those who send commands."""
        if not self.lockstep and not self.paused:
            self.schedule.start(origin)

    def tick(self) -> None:
        """Do what is due now by the steady clock; called by the main loop at a deadline."""
        now = time.monotonic_ns()
        schedule = self.schedule
        backlog = schedule.backlog(now)
        if backlog <= 1:
            self._publish(self._advance(1), self._wall_stamp(schedule.deadline))
            schedule.advance(now)
        elif backlog <= SHORT_BACKLOG:
            for _ in range(backlog):
                self._publish(self._advance(1), self._wall_stamp(schedule.deadline))
                schedule.advance(now)
        else:
            count = min(backlog, CHUNK)
            sample = self._advance(count)
            schedule.advance(now, count)
            if count == backlog:
                self._publish(sample, self._wall_stamp(now))
        # A command acts from the tick that follows it, as at the input register of a converter.
        self._active = (self.intake.command, self.intake.force)

    def _wall_stamp(self, deadline: int) -> int:
        if self._ros_clock.ros_time_is_active:  # use_sim_time, and somebody's /clock
            return self._ros_clock.now().nanoseconds
        # The deadline by the clock of the day: ticks that come late keep even stamps.
        return deadline + day_ahead()

    def _step(self) -> None:
        """Advance one period with the newest inputs, publish, then tick ``/clock``."""
        self._active = (self.intake.command, self.intake.force)
        sample = self._advance(1)
        if self.lockstep:
            stamp = round(self._ticks * SECOND / self._rate)
            self._publish(sample, stamp)
            self._clock_group.set_time(self.get_fully_qualified_name(), stamp)
        else:
            self._publish(sample, self._wall_stamp(time.monotonic_ns()))

    def _advance(self, count: int) -> Sample:
        """Advance the plant with the active inputs; one period is the common, fast case."""
        command, force = self._active
        try:
            if count == 1:
                sample = (self.plant.hold(force) if command is None
                          else self.plant.advance(command, force))
            else:
                sample = self._catch_up(count, command, force)
        except InputError as error:
            sample = self._recover(error)
        self._ticks += count
        self.last_sample = sample
        if self.watchdog.check(self._ticks):
            self.get_logger().warning(
                f'no command for {self.watchdog.timeout:g} s: the last one is held')
        return sample

    def _catch_up(self, count: int, command: float | None, force: float) -> Sample:
        if command is None:
            for _ in range(count):
                sample = self.plant.hold(force)
            return sample
        response = self.plant.run([command] * count, [force] * count)
        return Sample(*(float(column[-1]) for column in (
            response.displacement, response.velocity, response.charge, response.voltage,
            response.force)))

    def _recover(self, error: InputError) -> Sample:
        """
        Go back to the last state known to be good, without inputs; say so.

        Where that runs away as well, as under an effect that is new since: to the initial state.
        """
        again = self._failed_at is not None and self._ticks - self._failed_at < self._rate
        self._failures += 1
        self._failed_at = self._ticks
        now = self.plant.time  # hum and drift go on
        if again:
            self.plant.reset()
            self._last_good = self.plant.state
        self.plant.restore(replace(self._last_good, time=now))
        if self._active == (self.intake.command, self.intake.force):
            self.intake.clear()  # what came since acts from the next tick
        self._active = (None, 0.0)
        log = self.get_logger()
        if again:
            log.error(f'{error}; back to the initial state, inputs cleared',
                      throttle_duration_sec=1.0)
        else:
            log.error(f'{error}; back to the state of a second ago, inputs cleared',
                      throttle_duration_sec=1.0)
        return self.plant.sample()

    def _publish(self, sample: Sample, stamp: int) -> None:
        self._stamp = stamp
        self._displacement.publish(sample.displacement)
        self._charge.publish(sample.charge)
        self._force.publish(sample.force)
        self._voltage.publish(sample.voltage)
        self._state.publish(stamp, sample.displacement, sample.velocity, sample.force)

    # -- inputs --------------------------------------------------------------------

    def _on_command(self, port: str, message: Float64) -> None:
        if self.intake.take_command(port, message.data):
            self.watchdog.feed(self._ticks)
            if self.lockstep and not self.paused:
                self._step()

    def _on_force(self, message: Float64) -> None:
        if self.intake.take_force(message.data):
            # With leads open or shorted the force is the only input there is, so it steps.
            if self.lockstep and not self.paused and self.intake.force_is_the_input:
                self._step()

    def _on_step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self.lockstep or self.paused
        if response.success:
            self._step()
            response.message = f'time {self._ticks / self._rate:.9g} s'
        else:
            response.message = 'running by wall time: call ~/pause with true first'
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if request.data != self.paused:
            self.paused = request.data
            if self.paused:
                self.schedule.stop()
            else:
                self.start()
        response.success = True
        response.message = 'paused' if self.paused else 'playing'
        return response

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.plant.reset()
        self._last_good = self.plant.state
        self.intake.clear()
        self.watchdog.clear()
        self._active = (None, 0.0)
        self._ticks, self._failed_at = 0, None
        self.last_sample = self.plant.sample()
        if self.lockstep:
            self._stamp = 0
            self._clock_group.set_time(self.get_fully_qualified_name(), 0)
        response.success = True
        response.message = 'time 0 s, initial state'
        return response

    # -- parameters ------------------------------------------------------------------

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            device = self._parameter_table.changed(parameters)
            if device.effects != self._parameter_table.device.effects:
                if not is_bare(device) and not is_compiled():
                    raise InputError('what this effect needs is still being compiled, once on '
                                     'this machine; try again in half a minute')
                Plant(device)  # effects that do not go together are found when put together
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, parameters: list[Parameter]) -> None:
        old = self._parameter_table.device
        new = self._parameter_table.device = self._parameter_table.changed(parameters)
        if (new.effects, new.noise) != (old.effects, old.noise):
            self.plant.set_device(new)
        if new.command_timeout != old.command_timeout:
            self.watchdog.set_timeout(new.command_timeout)
        if new.drive != old.drive:
            self.plant.set_drive(new.drive)
            self.intake.switch(new.drive)
            self.watchdog.clear()
            self._active = (None, self.intake.force)
            self.get_logger().info(f'drive: {old.drive} -> {new.drive}')
        self._last_good = self.plant.state

    # -- once a second -----------------------------------------------------------------

    def keep_house(self) -> None:
        """Publish diagnostics, log what came up, remember a good state."""
        findings = self._findings()
        device = self._parameter_table.device
        stamp = self._stamp if self.lockstep or self._stamp else time.time_ns()
        self._diagnostics.publish(findings.to_message(
            f'{self.get_fully_qualified_name()}: piezo stack actuator',
            device.hardware_id or device.actuator.model, stamp))
        if not self._failures or self._failures == self._known_failures:
            self._last_good = self.plant.state
        self._known_failures = self._failures

    def _findings(self) -> Findings:
        found, schedule, intake = Findings(), self.schedule, self.intake
        if self._failures != self._known_failures:
            found.errors.append('the state left the finite numbers and was taken back')
        found.warnings += self._news.tell()
        found.warn_if(self.plant.charge_out_of_range,
                      'charge beyond the identified range: a Maxwell element that should not '
                      'slip has slipped; positions are off until reset')
        found.warn_if(self.watchdog.expired,
                      f'no command for {self.watchdog.timeout:g} s: the last one is held')
        late = schedule.late - self._known_late
        self._known_late = schedule.late
        found.warn_if(late, f'{late} late ticks in a second, caught up')
        name = self.get_fully_qualified_name()
        namesakes = self.get_fully_qualified_node_names().count(name)
        found.warn_if(namesakes > 1,
                      f'{namesakes} nodes are called {name}: each obeys the same commands and '
                      'publishes its own state; give one another name or namespace')
        if namesakes > max(1, self._known_namesakes):
            self.get_logger().warning(found.warnings[-1])
        self._known_namesakes = namesakes
        drivers = sum(self.count_publishers(s.topic_name) > 1 for s in self._command_inputs)
        found.warn_if(drivers, 'several publishers on one command topic: the newest command rules')
        if self.lockstep:
            found.warn_if(self.count_publishers('/clock') > 1, 'somebody else publishes /clock')
        sample, (command, force) = self.last_sample, self._active
        found.values = {
            'time': self._ticks / self._rate, 'drive': intake.drive,
            'stepping': 'lockstep' if self.lockstep else 'wall', 'paused': self.paused,
            'command': 'held' if command is None else command, 'external_force': force,
            'displacement': sample.displacement, 'charge': sample.charge,
            'force': sample.force, 'voltage': sample.voltage,
            'charge_out_of_range': self.plant.charge_out_of_range,
            'command_timed_out': self.watchdog.expired,
            **intake.tally.counts,
            'ticks': self._ticks, 'late_ticks': schedule.late,
            'ticks_over_half_ms': schedule.tardy, 'worst_lateness': schedule.worst / SECOND,
            'recovered_states': self._failures,
        }
        schedule.worst = 0
        return found

    def status(self) -> str:
        """Return one line for a terminal."""
        sample = self.last_sample
        command = self._active[0]
        unit, factor = ('µC', 1e6) if self.intake.drive == 'charge' else ('V', 1.0)
        held = '   held' if command is None else f'{command * factor:7.2f}'
        return (f'{self.get_fully_qualified_name()}  {self._ticks / self._rate:9.1f} s  '
                f'{self.intake.drive} {held} {unit}  x {sample.displacement * 1e6:8.4f} µm  '
                f'q {sample.charge * 1e6:8.3f} µC  F {sample.force:7.1f} N  '
                f'late {self.schedule.late}{"  PAUSED" if self.paused else ""}')
