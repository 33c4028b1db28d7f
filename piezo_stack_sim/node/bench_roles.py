# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The processes that the benchmark of the node runs: device, bare publisher, client.

    python -m piezo_stack_sim.node.bench_roles ROLE JSON

Each says ``ready`` on stdout, works until SIGTERM (the client until it is done),
and prints what it found as one line of JSON.
"""

from __future__ import annotations

from collections.abc import Callable
import json
import sys
import time

RESERVE = 2_000_000  # ticks noted at most


def device(rate: float, actuators: int = 1, stepping: str = 'wall') -> dict:
    """Run virtual devices and note how late each tick is (ns)."""
    from piezo_stack_sim.node import main, schedule
    from piezo_stack_sim.resources import config_file
    trace: list[int] = []
    schedule.Schedule.trace = trace
    arguments = []
    if actuators > 1:
        for number in range(actuators):
            arguments += ['--actuator', f'a{number}={config_file("ae0505d16.yaml")}']
    main.run([*arguments, '--ros-args', '-p', f'rate:={rate}', '-p', f'stepping:={stepping}'],
             lambda: print('ready', flush=True))
    return {'lateness': trace[:RESERVE]}


def bare(rate: float, publish: bool = True) -> dict:
    """Run a plain rclpy node whose timer publishes the same messages; note its ticks (ns)."""
    import rclpy
    from rclpy._rclpy_pybind11 import RCLError
    from rclpy.clock import Clock, ClockType
    from rclpy.executors import ExternalShutdownException
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64
    from piezo_stack_sim.node.actuator_node import OUTPUTS
    from piezo_stack_sim.node.loop import make_executor
    rclpy.init(args=[])
    node = rclpy.create_node('bare')
    topics = [node.create_publisher(Float64, f'~/{name}', 10) for name in OUTPUTS]
    state_topic = node.create_publisher(JointState, '~/state', 10)
    value, state = Float64(), JointState(name=['stack'], position=[0.0], velocity=[0.0],
                                         effort=[0.0])
    clock, ticks = node.get_clock(), []

    def tick():
        ticks.append(time.monotonic_ns())
        if publish and node.context.ok():
            value.data = 1e-9 * len(ticks)
            state.position[0] = state.velocity[0] = state.effort[0] = value.data
            state.header.stamp = clock.now().to_msg()
            for topic in topics:
                topic.publish(value)
            state_topic.publish(state)

    node.create_timer(1.0 / rate, tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
    executor = make_executor()
    executor.add_node(node)
    print('ready', flush=True)
    try:
        while rclpy.ok():
            # Not spin(): with the wheels it is a busy wait, see ActuatorNode's loop.
            executor.spin_once(1.0)
    except ExternalShutdownException:
        pass
    except RCLError:
        if node.context.ok():  # else the signal to end came between two messages of a tick
            raise
    return {'ticks': ticks[:RESERVE]}


def sleeper(rate: float) -> dict:
    """Sleep until one deadline after the other, without ROS; note how late each is (ns)."""
    import signal
    from piezo_stack_sim.node.realtime import sharpen_timers
    sharpen_timers()
    lateness: list[int] = []
    stopped: list[bool] = []
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(True))
    print('ready', flush=True)
    deadline, period = time.monotonic_ns(), round(1e9 / rate)
    while not stopped:
        deadline += period
        while (wait := deadline - time.monotonic_ns()) > 0:
            time.sleep(wait * 1e-9)
        lateness.append(time.monotonic_ns() - deadline)
    return {'lateness': lateness[:RESERVE]}


def listener(topics: list[str]) -> dict:
    """Hear what a node publishes, as a recorder would."""
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64
    from piezo_stack_sim.node.loop import make_executor
    rclpy.init(args=[])
    node, count = rclpy.create_node('listener'), [0]

    def hear(message):
        count[0] += 1

    for topic in topics:
        kind = JointState if topic.endswith('/state') else Float64
        node.create_subscription(kind, topic, hear, 10)
    executor = make_executor()
    executor.add_node(node)
    print('ready', flush=True)
    try:
        while rclpy.ok():
            executor.spin_once(1.0)
    except ExternalShutdownException:
        pass
    return {'heard': count[0]}


def client(exchanges: int, burst: int) -> dict:
    """Time lockstep: command to sample and back, one by one; then many commands at once."""
    from piezo_stack_sim.examples.stack_client import in_ros, StackClient
    found: dict = {}

    def task():
        stack = StackClient('/piezo_stack_node', 'voltage')
        stack.reset()
        for _ in range(200):
            stack.exchange(1.0)
        laps = [time.monotonic_ns()]
        for k in range(exchanges):
            stack.exchange(50.0 + 40.0 * (k % 2))
            laps.append(time.monotonic_ns())
        found['round_trips'] = [b - a for a, b in zip(laps, laps[1:])]
        found['burst_rate'] = burst / stack.stream([10.0] * burst)
        stack.close()

    print('ready', flush=True)
    in_ros([], task)
    return found


ROLES: dict[str, Callable[..., dict]] = {
    'device': device, 'bare': bare, 'sleeper': sleeper, 'listener': listener, 'client': client}


if __name__ == '__main__':
    print(json.dumps(ROLES[sys.argv[1]](**json.loads(sys.argv[2]))), flush=True)
