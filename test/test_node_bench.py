# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Claims about the benchmark of the node: it measures; what it finds is up to the machine."""

import pytest

pytest.importorskip('rclpy')

from piezo_stack_sim.node import bench  # noqa: E402, I100


def test_device_and_bare_node_are_measured_alike():
    device = bench.device_timing(rate=200.0, seconds=0.5)
    bare = bench.bare_timing(rate=200.0, seconds=0.5)
    assert device.ticks > 50 and bare.ticks > 50
    sleep = bench.sleep_timing(rate=200.0, seconds=0.5)
    assert device.missed == sleep.missed == 0  # late ones are caught up
    assert bench.cpu_ratio(device, bare) > 0.0
    assert sleep.cpu < device.cpu
    for timing in (device, bare):
        assert 0.0 < timing.cpu < 2.0
    for timing in (device, bare, sleep):
        assert timing.late_p50 <= timing.late_p99 <= timing.late_p999 <= timing.late_max


def test_lockstep_is_timed_by_a_client_in_another_process():
    speed = bench.lockstep_speed(exchanges=50, burst=50)
    assert speed.exchanges_per_second > 0.0 and speed.burst_per_second > 0.0
    assert 0.0 < speed.round_trip_p50 <= speed.round_trip_p99
