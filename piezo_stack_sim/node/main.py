# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command ``piezo_stack_node``: the virtual device, or several of them in one process."""

from __future__ import annotations

import argparse
from collections.abc import Callable
import sys
import time

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.node.interrupts import attach, interruptible

_DESCRIPTION = """\
A virtual piezoelectric stack actuator with the topics of a real one's driver.
ROS arguments follow --ros-args: --params-file FILE, -p NAME:=VALUE, -r __ns:=/NAMESPACE."""


class _Parser(argparse.ArgumentParser):

    def error(self, message):
        raise InputError(f'piezo_stack_node: {message}; see piezo_stack_node --help')


def _arguments(own: list[str]) -> argparse.Namespace:
    parser = _Parser(prog='piezo_stack_node', description=_DESCRIPTION,
                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--actuator', action='append', default=[], metavar='NAMESPACE=FILE',
                        help='one device in this namespace with this parameter file; repeat it '
                             'for several in this process')
    parser.add_argument('--status', action='store_true',
                        help='show a line of state in the terminal, once a second')
    parser.add_argument('--realtime-priority', type=int, metavar='N',
                        help='run under SCHED_FIFO with this priority, if permitted')
    parser.add_argument('--lock-memory', action='store_true',
                        help='keep memory from being swapped out, if permitted')
    parser.add_argument('--executor', choices=('auto', 'events', 'single'), default='auto',
                        help='which rclpy executor; auto: the faster one that there is')
    return parser.parse_args(own)


def _actuators(rows: list[str]) -> list[tuple[str, str]]:
    """Split NAMESPACE=FILE; no row means one device in the default namespace."""
    pairs = []
    for row in rows:
        namespace, equals, file = row.partition('=')
        if not equals or not file:
            raise InputError(f'--actuator {row}: expected NAMESPACE=FILE, such as left=left.yaml')
        pairs.append((namespace, file))
    names = [name.strip('/') for name, _ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f'--actuator {name}=...: expected different namespaces; this one '
                             'is given twice')
    return pairs


def _given(arguments: list[str], *flags: str) -> list[str]:
    """Return what follows each occurrence of a flag among ROS arguments."""
    return [after for flag, after in zip(arguments, arguments[1:]) if flag in flags]


def _one_line(error: BaseException) -> str:
    return ' '.join(str(error).split())


def _reason(error: BaseException, files: list[str]) -> InputError:
    """Put into words why ROS did not like its arguments: most likely a parameter file."""
    from piezo_stack_sim.plant.parameters import load_device
    for file in files:
        load_device(file)
    text = _one_line(error)
    if 'same type' in text:
        text += '; ROS wants all numbers of a list with a decimal point, or none'
    return InputError(f'{", ".join(files) or "ROS arguments"}: {text}')


def _warm_up(device) -> None:
    """Meet everything that is compiled or loaded when first used, before a tick has to."""
    from piezo_stack_sim.plant import Plant
    plant = Plant(device)
    for drive in ('voltage', 'charge', 'open', 'shorted', device.drive):
        plant.set_drive(drive)
        plant.hold(0.0)
        plant.advance(1e-9, 1.0)
        plant.run([0.0] * 3, [0.0] * 3)
        plant.sample()
    plant.restore(plant.state)
    plant.set_device(device)


def _warm_up_effects(nodes) -> None:
    """Do the same for devices with an effect on: other kernels take over then."""
    from piezo_stack_sim.effects.registry import EFFECTS
    for node in nodes:
        for name in 'creep', 'sensor_lag':  # one acts on the stack, one only follows it
            _warm_up(node.plant.device.with_effects({name: EFFECTS[name].typical()}))


def _build(options: argparse.Namespace, ros_arguments: list[str]):
    """Make the nodes."""
    from piezo_stack_sim.node.actuator_node import ActuatorNode
    from piezo_stack_sim.node.simulation_clock import SimulationClock
    from rclpy.exceptions import InvalidNamespaceException
    clock = SimulationClock()
    files = _given(ros_arguments, '--params-file')
    single = _given(ros_arguments, '-p', '--param')
    nodes = []
    actuators = _actuators(options.actuator) or [('', '')]
    shared = [rule for rule in _given(ros_arguments, '-r', '--remap') if rule.startswith('__ns:=')]
    if len(actuators) > 1 and shared:
        space = shared[-1].removeprefix('__ns:=').strip('/')
        raise InputError(f'-r {shared[-1]}: expected none beside several --actuator, which would '
                         f'share it; write --actuator {space}/{actuators[0][0].strip("/")}=...')
    for namespace, file in actuators:
        own = None
        if file:  # arguments of one node go before those of all, which -p is meant to overrule
            own = ['--ros-args', '--params-file', file,
                   *(part for value in single for part in ('-p', value))]
        every = files + ([file] if file else [])
        try:
            nodes.append(ActuatorNode(clock, namespace, every, not single, own))
        except InvalidNamespaceException as error:
            raise InputError(f'--actuator {namespace}=...: {_one_line(error)}') from None
        except RuntimeError as error:
            raise _reason(error, every) from None
    return nodes


def run(arguments: list[str], when_ready: Callable[[], object] = lambda: None) -> None:
    """
    Run the node with these arguments until SIGINT or SIGTERM.

    ``when_ready`` is called when the node is about to run.

    Raises
    ------
    InputError
        If an argument or a parameter is wrong.

    """
    with interruptible():
        _run(arguments, when_ready)


def _run(arguments: list[str], when_ready: Callable[[], object]) -> None:
    began = time.monotonic()
    import rclpy
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import remove_ros_args
    try:
        options = _arguments(remove_ros_args(['piezo_stack_node', *arguments])[1:])
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise _reason(error, _given(arguments, '--params-file')) from None
    nodes = []
    try:
        nodes = _build(options, arguments)
        _serve(nodes, options, began, when_ready)
    except KeyboardInterrupt:
        pass
    except Exception:
        # A signal shuts ROS down, and whatever needs it next complains: that is the end that
        # was asked for, not a fault.
        if rclpy.ok():
            raise
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()


def _serve(nodes, options: argparse.Namespace, began: float,
           when_ready: Callable[[], object]) -> None:
    from piezo_stack_sim.node import realtime
    from piezo_stack_sim.node.loop import Loop, make_executor
    from piezo_stack_sim.plant.compilation import is_compiled, LateKernel
    log = nodes[0].get_logger()
    for node in nodes:
        _warm_up(node.plant.device)
    complete = is_compiled()
    if complete:
        _warm_up_effects(nodes)
    realtime.sharpen_timers()
    if options.realtime_priority is not None:
        _warn(log, realtime.set_priority(options.realtime_priority))
    if options.lock_memory:
        _warn(log, realtime.lock_memory())
    executor = make_executor(options.executor)
    attach(executor, nodes)
    loop = Loop(nodes, executor, options.status)
    realtime.quiet_collector()
    for node in nodes:
        device = node.plant.device
        node.get_logger().info(
            f'ready: {device.actuator.model}, drive {device.drive}, '
            f'{"lockstep" if node.lockstep else "wall time"} at {device.rate:g} Hz, '
            f'{type(executor).__name__}, after {time.monotonic() - began:.1f} s')
    when_ready()
    late = None
    if not complete:
        log.info('compiling the effects, once on this machine; until that is done most of them '
                 'cannot be switched on')

        def loaded() -> None:
            _warm_up_effects(nodes)
            log.info('compiled: every effect can be switched on now')

        def failed(status: int) -> None:
            log.warning(f'compiling the effects failed with status {status}; stop the node and '
                        'see why: python3 -m piezo_stack_sim.plant.compilation all')

        late = LateKernel(loaded, failed)
    try:
        loop.run()
    finally:
        if late is not None:
            late.stop()
        executor.shutdown()


def _warn(log, trouble: str | None) -> None:
    if trouble:
        log.warning(trouble)


def main() -> int:
    """Run the command; 0 after SIGINT or SIGTERM, 2 if an argument or a parameter is wrong."""
    try:
        run(sys.argv[1:])
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:  # before the node was ready
        pass
    return 0


if __name__ == '__main__':
    sys.exit(main())
