# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recordings into rosbag2 folders, with the topics of the virtual device, without ROS."""

from pathlib import Path
import shutil
import tempfile

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.bag import DRIVE_KEY

STORAGES = ('mcap', 'sqlite3')


def write_bag(recording, path, storage='mcap', node='/piezo_stack'):
    """
    Write one recording as a rosbag2 folder.

    Each row becomes one tick: the measured topics and, with displacement, the stamped state at the
    row's time, then the command and the force, one nanosecond later. The folder appears complete
    or not at all.

    Parameters
    ----------
    recording : Recording
        Times of at least zero.
    path : str or Path
        The folder to make; it must not exist.
    storage : str
        'mcap' or 'sqlite3'.
    node : str
        The namespace of the topics.

    Raises
    ------
    InputError
        When the folder exists or cannot be written, or a time is negative or not finite.

    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
    except ImportError as error:
        raise InputError(f'{path}: writing bags needs rosbags: pip install rosbags') from error

    path = Path(path)
    if storage not in STORAGES:
        raise InputError(f'{path}: storage {storage!r}: expected one of {", ".join(STORAGES)}')
    if path.exists():
        raise InputError(f'{path}: exists already: remove it or choose another')
    if not np.all((recording.time >= 0.0) & (recording.time < 9e9)):
        raise InputError(f'{path}: a bag has times from 0 to 9e9 s; {recording.name} has others')
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix='.partial-', dir=path.parent))
        # The storage file is named after its folder.
        folder = temporary / path.name
        with Writer(folder, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
            writer.set_custom_data(DRIVE_KEY, recording.drive)
            _fill(writer, recording, node)
        folder.replace(path)
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error.strerror or error}') from error
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def _fill(writer, recording, node):
    from rosbags.typesys import get_typestore, Stores

    types = get_typestore(Stores.ROS2_JAZZY)
    number = types.types['std_msgs/msg/Float64']
    inputs = {}
    if recording.command_name:
        inputs[recording.command_name] = recording.command
    if recording.has_force:
        inputs['external_force'] = recording.external_force
    columns = {**recording.measured, **inputs}
    connections = {
        name: writer.add_connection(f'{node}/{name}', number.__msgtype__, typestore=types)
        for name in columns
    }
    state = _StateWriter(writer, types, node) if 'displacement' in columns else None
    columns = {name: values.tolist() for name, values in columns.items()}
    for k, nanoseconds in enumerate(np.rint(recording.time * 1e9).astype(np.int64).tolist()):
        if state:
            state.write(nanoseconds, columns['displacement'][k])
        for name, values in columns.items():
            raw = types.serialize_cdr(number(values[k]), number.__msgtype__)
            writer.write(connections[name], nanoseconds + (name in inputs), raw)


class _StateWriter:
    """The stamped ~/state."""

    def __init__(self, writer, types, node):
        self._writer, self._types = writer, types
        self._state = types.types['sensor_msgs/msg/JointState']
        self._header = types.types['std_msgs/msg/Header']
        self._time = types.types['builtin_interfaces/msg/Time']
        self._connection = writer.add_connection(
            f'{node}/state', self._state.__msgtype__, typestore=types)

    def write(self, nanoseconds, displacement):
        """Write one message."""
        stamp = self._time(nanoseconds // 10**9, nanoseconds % 10**9)
        none = np.empty(0)
        message = self._state(
            self._header(stamp, ''), ['displacement'], np.array([displacement]), none, none)
        raw = self._types.serialize_cdr(message, self._state.__msgtype__)
        self._writer.write(self._connection, nanoseconds, raw)
