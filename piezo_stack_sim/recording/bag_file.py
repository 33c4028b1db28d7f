# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Bags opened without ROS: rosbag2 folders, single MCAP and sqlite3 files, also of killed recorders.

Whatever a damaged or hostile file makes the reading library raise comes out as InputError.
"""

from contextlib import contextmanager
import heapq
from pathlib import Path
import re

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.finding import Finding, NOTE, shown
from piezo_stack_sim.recording.mcap_end import mended, MendedMcap

FILE_ENDINGS = ('.mcap', '.db3')


def is_bag(path):
    """Return whether a path is a rosbag2 folder or one of its storage files."""
    path = Path(path)
    if path.is_dir():
        return (path / 'metadata.yaml').is_file() or bool(unlisted_files(path))
    return path.suffix.lower() in FILE_ENDINGS


def unlisted_files(folder):
    """
    Return the storage files of a bag folder whose recorder was killed before metadata.yaml.

    rosbag2 names them after the folder, ``run_0.mcap``, ``run_1.mcap`` in ``run/``.

    """
    folder = Path(folder)
    if (folder / 'metadata.yaml').exists():
        return []
    pattern = re.compile(re.escape(folder.resolve().name) + r'_(\d+)\.(mcap|db3)')
    found = [(int(match[1]), path) for path in folder.iterdir()
             if (match := pattern.fullmatch(path.name))]
    return [path for _, path in sorted(found)]


def _check_sqlite(path):
    """Raise InputError for what sqlite would misread in silence."""
    if {'?', '#', '%'} & set(str(path.resolve())):
        raise InputError(f'{path}: sqlite cannot open a path with ?, # or %: rename it')
    log = path.with_name(f'{path.name}-wal')
    if log.exists() and log.stat().st_size:
        raise InputError(
            f'{path}: {log.name} beside it holds rows that were not merged yet: merge them with '
            f"sqlite3 {path.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
        )


def _in_order(messages, depth=4096):
    """Sort messages by arrival that are out of order by at most `depth` places."""
    waiting = []
    for number, (connection, arrival, raw) in enumerate(messages):
        item = (arrival, number, connection, raw)
        if len(waiting) < depth:
            heapq.heappush(waiting, item)
        else:
            arrival, _, connection, raw = heapq.heappushpop(waiting, item)
            yield connection, arrival, raw
    for arrival, _, connection, raw in sorted(waiting):
        yield connection, arrival, raw


class Bag:
    """
    An open bag.

    Attributes
    ----------
    source : str
        Its path.
    topics : dict of str to (str, int, bool)
        Name to message type, number of messages, and whether the messages carry a stamp.
    stated : dict of str to str
        The custom data of metadata.yaml.
    findings : list of Finding
        What was found when opening it.

    """

    def __init__(self, source, readers, findings):
        from rosbags.typesys import get_typestore, Stores

        self.source = source
        self.findings = findings
        self._readers = readers
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self.stated = {}
        counts = {}
        for reader in readers:
            metadata = getattr(getattr(reader, 'storage', None), 'metadata', None)
            self.stated.update(getattr(metadata, 'custom', None) or {})
            for connection in reader.connections:
                name, kind = str(connection.topic), str(connection.msgtype)
                known, count = counts.get(name, (kind, 0))
                if known != kind:
                    raise InputError(f'{source}: topic {name} has two types, {known} and {kind}')
                counts[name] = (kind, count + max(int(connection.msgcount), 0))
        self._learn()
        self.topics = {
            name: (kind, count, self._stamped(kind)) for name, (kind, count) in counts.items()
        }

    def _learn(self):
        """Take from the bag the definitions of types that Jazzy does not have."""
        from rosbags.interfaces import MessageDefinitionFormat
        from rosbags.typesys import get_types_from_idl, get_types_from_msg

        for connection in (each for reader in self._readers for each in reader.connections):
            kind, form = connection.msgtype, connection.msgdef.format
            if kind in self._types.fielddefs or form == MessageDefinitionFormat.NONE:
                continue
            if form == MessageDefinitionFormat.MSG:
                found = get_types_from_msg(connection.msgdef.data, kind)
            else:
                found = get_types_from_idl(connection.msgdef.data)
            self._types.register(
                {name: each for name, each in found.items() if name not in self._types.fielddefs})

    def _stamped(self, kind):
        fields = self._types.fielddefs.get(kind, ((), ()))[1]
        return any(name == 'header' for name, _ in fields)

    def _stored(self, reader, chosen):
        if isinstance(reader.storage.path, MendedMcap):
            # Without an index the library wants the order in which it was recorded to be perfect.
            return _in_order(reader.storage.messages_scan(chosen))
        return reader.messages(connections=chosen)

    def messages(self, topics):
        """
        Yield the messages of some topics in the order of their arrival.

        Yields
        ------
        tuple of (str, int, bytes, callable)
            Topic, arrival (ns), the message as stored, and a function that unpacks it.

        Raises
        ------
        InputError
            When the bag is damaged, or a type is unknown.

        """
        kinds = {name: self.topics[name][0] for name in topics}
        for kind in kinds.values():
            if kind not in self._types.fielddefs:
                raise InputError(f'{self.source}: no definition of {kind} in the bag or in Jazzy')
        unpack = {
            name: (lambda raw, kind=kind: self._types.deserialize_cdr(raw, kind))
            for name, kind in kinds.items()
        }
        for reader in self._readers:
            chosen = [each for each in reader.connections if each.topic in kinds]
            for connection, arrival, raw in self._stored(reader, chosen) if chosen else ():
                yield connection.topic, int(arrival), raw, unpack[connection.topic]


@contextmanager
def damaged_is_input_error(source):
    """Turn whatever a damaged bag makes its reader raise into InputError."""
    try:
        yield
    except InputError:
        raise
    # The library raises struct.error, AssertionError, KeyError, apsw's errors and many others.
    except Exception as error:  # noqa: B902
        detail = f'{type(error).__name__}: {error}'[:200]
        raise InputError(f'{source}: damaged or not a bag ({shown(detail, 200)})') from error


def _in_any_case(reader, ending):
    """Return a class that reads files whose ending is written in capitals, too."""
    known = reader.STORAGE_PLUGINS
    if ending in known or ending.lower() not in known:
        return reader
    return type('Reader', (reader,), {
        'STORAGE_PLUGINS': {**known, ending: known[ending.lower()]}})


@contextmanager
def open_bag(path):
    """
    Open a rosbag2 folder, an MCAP file or a sqlite3 file.

    Yields
    ------
    Bag

    Raises
    ------
    InputError
        When it is none of these or damaged.

    """
    try:
        from rosbags.rosbag2 import Reader
    except ImportError as error:
        raise InputError(f'{path}: reading bags needs rosbags: pip install rosbags') from error

    path = Path(path)
    source, findings, opened = str(path), [], []
    try:
        with damaged_is_input_error(source):
            files = [path]
            if path.is_dir() and not (path / 'metadata.yaml').exists():
                files = unlisted_files(path)
                if not files:
                    raise InputError(f'{source}: a folder without metadata.yaml: not a bag')
                findings.append(Finding(
                    source, None, NOTE, 'metadata.yaml is missing: the recorder was killed',
                    f'read from {", ".join(each.name for each in files)}'))
            for each in files:
                ending = each.suffix.lower()
                reader = _in_any_case(Reader, each.suffix)(each)
                if ending == '.db3':
                    _check_sqlite(each)
                end = mended(each) if ending == '.mcap' and each.is_file() else None
                if end:
                    reader.storage.path = end[0]  # type: ignore[attr-defined]
                    findings.append(end[1])
                reader.open()
                opened.append(reader)
            bag = Bag(source, opened, findings)
        yield bag
    finally:
        for reader in opened:
            reader.close()
