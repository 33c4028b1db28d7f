# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``/clock``: the one time of all devices of a process that are stepped."""

from __future__ import annotations

from piezo_stack_sim.node.messages import ClockTopic


class SimulationClock:
    """
    Publishes the time that all of its devices have reached.

    One device: its time. Several: the time of the slowest one, because a time
    that has been announced must not lie in anybody's future.

    """

    def __init__(self) -> None:
        self._topic: ClockTopic | None = None
        self._times: dict[str, int] = {}
        self._told: int | None = None

    def join(self, device: str, topic: ClockTopic | None) -> None:
        """Take part; the publisher of the first device that has one serves them all."""
        self._times[device] = 0
        self._topic = self._topic or topic

    @property
    def has_topic(self) -> bool:
        """Whether somebody has brought a publisher."""
        return self._topic is not None

    def set_time(self, device: str, time: int) -> None:
        """Note the time (ns) of a device; publish if that changes what all have reached."""
        self._times[device] = time
        now = min(self._times.values())
        if now != self._told and self._topic is not None:
            self._told = now
            self._topic.publish(now)
