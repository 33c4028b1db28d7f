# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A driver that dies: publishes a command until it is killed, or as often as asked.

    python -m piezo_stack_sim.node.soak.publisher TOPIC VALUE RATE

"""

from __future__ import annotations

import sys
import time


def main() -> int:
    """Publish; never ends by itself."""
    import rclpy
    from std_msgs.msg import Float64
    topic, value, rate = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
    rclpy.init(args=[])
    node = rclpy.create_node(f'driver_{time.monotonic_ns()}', namespace='/soak')
    publisher = node.create_publisher(Float64, topic, 10)
    message = Float64(data=value)
    while True:
        publisher.publish(message)
        time.sleep(1.0 / rate)


if __name__ == '__main__':
    main()
