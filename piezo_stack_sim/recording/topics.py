# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which topic of a bag holds which channel, and how to take the number out of a message."""

from dataclasses import dataclass
import re
import struct

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.finding import Finding, NOTE, shown
from piezo_stack_sim.recording.mapping import CHANNELS, suggestion, TopicField

_FLOAT = 'std_msgs/msg/Float64'
_SCALAR = re.compile(r'std_msgs/msg/(Float|Int|UInt)\d+')
_STATE = 'sensor_msgs/msg/JointState'
_LITTLE, _BIG = struct.Struct('<d'), struct.Struct('>d')


@dataclass(frozen=True)
class Source:
    """
    Where a channel is read from.

    Attributes
    ----------
    channel : str
        The channel.
    field : TopicField
        Topic and path into the message.
    kind : str
        The message type.
    count : int
        How many messages the bag says to have.
    stamped : bool
        Whether its messages have a header with a stamp.

    """

    channel: str
    field: TopicField
    kind: str
    count: int
    stamped: bool

    def value(self, raw, unpack):
        """
        Return the number in a message and its stamp.

        Parameters
        ----------
        raw : bytes
            The message as stored.
        unpack : callable
            Makes an object of it.

        Returns
        -------
        tuple of (float, int or None)
            The value, and the stamp in ns; None for messages without one.

        Raises
        ------
        InputError
            When the path does not lead to a number.

        """
        if self.kind == _FLOAT and self.field.path in ((), ('data',)) and len(raw) >= 12:
            # The second byte of the encapsulation header tells the byte order.
            return (_LITTLE if raw[1] & 1 else _BIG).unpack_from(raw, 4)[0], None
        message = unpack(raw)
        stamp = None
        if self.stamped:
            stamp = int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)
        return self._follow(message), stamp

    def _follow(self, message):
        here = message
        for step in self.field.path or ('data',):
            if isinstance(step, int):
                if not hasattr(here, '__len__') or isinstance(here, str):
                    raise InputError(f'--map {self.channel}={self.field}: [{step}] of no list')
                if step >= len(here):
                    # A driver that lost its sensor sends short lists: a missing sample.
                    return float('nan')
                here = here[step]
            else:
                fields = getattr(here, '__dataclass_fields__', {})
                if step not in fields:
                    known = [name for name in fields if not name.startswith('__')]
                    raise InputError(
                        f'--map {self.channel}={self.field}: no field {step!r}'
                        f'{suggestion(step, known)} in {self.kind}: '
                        f'it has {", ".join(known) or "no fields"}'
                    )
                here = getattr(here, step)
        if not isinstance(here, (int, float, np.number)):
            raise InputError(
                f'--map {self.channel}={self.field}: {shown(here)} is not a number: say which, '
                'as in position[0]'
            )
        return float(here)


def _candidates(channel, topics):
    """Return the fields that may hold a channel under the project's own names, best first."""
    states = [name for name, (kind, _, _) in topics.items()
              if channel == 'displacement' and name.endswith('/state') and kind == _STATE]
    plain = [name for name, (kind, _, _) in topics.items()
             if name.rpartition('/')[2] == channel and _SCALAR.fullmatch(kind)]
    # The stamped state is worth more than the same number without a stamp.
    best = [TopicField(name, ('position', 0)) for name in states if topics[name][1]]
    return best or [TopicField(name, ('data',)) for name in plain]


def choose_topics(source, topics, mapping):
    """
    Find the source of each channel.

    Parameters
    ----------
    source : str
        The bag, for messages.
    topics : dict
        `Bag.topics`.
    mapping : dict
        From `parse_mapping`; entries for columns are ignored.

    Returns
    -------
    tuple of (dict of str to Source, list of Finding)

    Raises
    ------
    InputError
        A mapped topic is missing, or a channel has several topics.

    """
    sources, findings = {}, []
    for channel in CHANNELS[1:]:
        field = mapping.get(channel)
        if isinstance(field, TopicField):
            if field.topic not in topics:
                raise InputError(
                    f'{source}: --map {channel}={field}: no such topic'
                    f'{suggestion(field.topic, topics)}: it has {", ".join(sorted(topics)[:12])}'
                )
        else:
            fields = _candidates(channel, topics)
            busy = [each for each in fields if topics[each.topic][1]]
            if len(busy) > 1:
                raise InputError(
                    f'{source}: {" and ".join(each.topic for each in busy[:3])} may both be '
                    f'{channel}: choose with --map {channel}={busy[0].topic}'
                )
            if not busy:
                findings += [
                    Finding(source, None, NOTE, f'{each.topic} has no messages', 'not used')
                    for each in fields
                ]
                continue
            field = busy[0]
        kind, count, stamped = topics[field.topic]
        sources[channel] = Source(channel, field, kind, count, stamped)
    return sources, findings
