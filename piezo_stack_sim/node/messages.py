# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Messages of a fixed shape, encoded once and then only filled in.

Publishing a message object makes rclpy walk through it field by field, some
10 us each. Only a few numbers change from tick to tick, so each message is
serialised once, the places of its numbers are found, and a tick writes the
numbers there: what goes over the wire is the same.
"""

from __future__ import annotations

import struct

from builtin_interfaces.msg import Time
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Header

_DOUBLE = struct.Struct('=d')
_STAMP = struct.Struct('=iI')
# Numbers that stand nowhere else in a message, to find the fields by.
_MARKS = (-1.2345678901234567e+89, -2.3456789012345678e+91, -3.4567890123456789e+93)
_SECONDS, _NANOSECONDS = 0x5bc3a971, 0x2ad7e315


def _place(encoded: bytes, mark: bytes) -> int:
    if encoded.count(mark) != 1:
        raise RuntimeError('this middleware encodes messages in an unknown way')
    return encoded.index(mark)


class FloatTopic:
    """A publisher of std_msgs/Float64 that takes plain numbers."""

    def __init__(self, publisher: Publisher) -> None:
        encoded = serialize_message(Float64(data=_MARKS[0]))
        self._buffer = bytearray(encoded)
        self._data = _place(encoded, _DOUBLE.pack(_MARKS[0]))
        self._publish = publisher.publish

    def publish(self, value: float) -> None:
        """Publish one number."""
        _DOUBLE.pack_into(self._buffer, self._data, value)
        self._publish(bytes(self._buffer))


class StateTopic:
    """A publisher of sensor_msgs/JointState with one joint."""

    def __init__(self, publisher: Publisher, joint: str) -> None:
        message = JointState(
            header=Header(stamp=Time(sec=_SECONDS, nanosec=_NANOSECONDS)), name=[joint],
            position=[_MARKS[0]], velocity=[_MARKS[1]], effort=[_MARKS[2]])
        encoded = serialize_message(message)
        self._buffer = bytearray(encoded)
        self._stamp = _place(encoded, _STAMP.pack(_SECONDS, _NANOSECONDS))
        self._position, self._velocity, self._effort = (
            _place(encoded, _DOUBLE.pack(mark)) for mark in _MARKS)
        self._publish = publisher.publish

    def publish(self, stamp: int, position: float, velocity: float, effort: float) -> None:
        """Publish a stamp (ns), a position (m), a velocity (m/s) and an effort (N)."""
        buffer = self._buffer
        _STAMP.pack_into(buffer, self._stamp, stamp // 1_000_000_000, stamp % 1_000_000_000)
        _DOUBLE.pack_into(buffer, self._position, position)
        _DOUBLE.pack_into(buffer, self._velocity, velocity)
        _DOUBLE.pack_into(buffer, self._effort, effort)
        self._publish(bytes(buffer))


class ClockTopic:
    """A publisher of rosgraph_msgs/Clock that takes nanoseconds."""

    def __init__(self, publisher: Publisher) -> None:
        encoded = serialize_message(Clock(clock=Time(sec=_SECONDS, nanosec=_NANOSECONDS)))
        self._buffer = bytearray(encoded)
        self._stamp = _place(encoded, _STAMP.pack(_SECONDS, _NANOSECONDS))
        self._publish = publisher.publish

    def publish(self, stamp: int) -> None:
        """Publish a time (ns)."""
        _STAMP.pack_into(self._buffer, self._stamp, stamp // 1_000_000_000, stamp % 1_000_000_000)
        self._publish(bytes(self._buffer))
