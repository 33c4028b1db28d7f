# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""ROS 2 parameter files: read without ROS, written so that ROS and people can read them."""

from difflib import get_close_matches
from pathlib import Path
import re

from piezo_stack_sim.atomic import note_input, write_text
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant.parameters.table import parameter_specs
from piezo_stack_sim.plant.parameters.validation import device_from_mapping, shown
import yaml

LARGEST = 1_000_000  # bytes; a parameter file has a few thousand
DEEPEST = 50


def load_device(path, node=None):
    """
    Read and check a ROS 2 parameter file.

    Parameters
    ----------
    path : str or Path
        A file with one or more sections ``<node name>: ros__parameters:``.
    node : str, optional
        Full name of the node, such as ``/left/piezo_stack``: only sections that match it count.
        Without it every section counts, and a file for several nodes is refused.

    Returns
    -------
    Device

    Raises
    ------
    InputError
        The file cannot be read, is no parameter file, or holds a wrong key or value.

    """
    path = Path(path)
    sections = _sections(_parse(_read(path), path), '', path)
    if not sections:
        raise InputError(f'{path}: expected "/**:" with "ros__parameters:" below it, found '
                         'nothing; give a ROS 2 parameter file')
    if node is not None:
        chosen = [s for s in sections if _matches(s[0], node)]
        if not chosen:
            names = ', '.join(name for name, _ in sections)
            raise InputError(f'{path}: no section for node {node}; it has {names}')
    else:
        chosen = sections
        named = sorted({name for name, _ in sections if '*' not in name})
        if len(named) > 1:
            raise InputError(
                f'{path}: expected parameters of one device, found {", ".join(named)}; '
                'make one file for each')
    mapping, lines = {}, {}
    for _, section in chosen:  # as in ROS, later sections win
        rows = list(_flatten(section, ''))
        seen = {}
        for name, value, line in rows:
            if name in seen:
                raise InputError(f'{path}:{line}: {name} = {shown(value)}: expected once, it '
                                 f'stands in line {seen[name]} too; remove one')
            seen[name] = line
            mapping[name] = value
        lines.update(seen)
    return device_from_mapping(mapping, path, lines)


def save_device(device, path, comment='', node='/**'):
    """
    Write a device as a ROS 2 parameter file, atomically.

    Parameters
    ----------
    device : Device
        What to write.
    path : str or Path
        The file; missing folders are made.
    comment : str
        Text for the head of the file; may have several lines.
    node : str
        Name of the node, or a wildcard.

    Raises
    ------
    InputError
        The file cannot be written.

    """
    write_text(path, device_yaml(device, comment, node))


def device_yaml(device, comment='', node='/**'):
    """Return the text that `save_device` writes."""
    specs = parameter_specs()
    rows = [f'# {line}'.rstrip() for line in comment.splitlines()]
    rows += [f'{_scalar(node)}:', '  ros__parameters:']

    def section(values, prefix, indent):
        for key, value in values.items():
            name = f'{prefix}{key}'
            if isinstance(value, dict):
                if value or name != 'effects':
                    rows.append(f'{indent}{key}:' + ('' if value else ' {}'))
                    section(value, f'{name}.', indent + '  ')
                continue
            unit = specs[name].unit if name in specs else ''
            rows.append(f'{indent}{key}: {_scalar(value)}' + (f'  # {unit}' if unit else ''))

    section(device.to_mapping(), '', '    ')
    return '\n'.join(rows) + '\n'


def _scalar(value):
    if isinstance(value, tuple):
        value = [float(v) for v in value]
    elif isinstance(value, float):
        value = float(value)  # NumPy's floats are floats, but not to YAML
    text = yaml.safe_dump(value, default_flow_style=True, width=10**6, allow_unicode=True)
    return text.removesuffix('\n').removesuffix('\n...')


def _read(path):
    try:
        if path.stat().st_size > LARGEST:
            raise InputError(f'{path}: expected a parameter file, found more than 1 MB; '
                             'give the right file')
        return note_input(path).read_text(encoding='utf-8')
    except FileNotFoundError:
        raise InputError(f'{path}: no such file; check the path') from None
    except IsADirectoryError:
        raise InputError(f'{path}: expected a file, found a folder; name the file') from None
    except UnicodeDecodeError:
        raise InputError(f'{path}: expected YAML text in UTF-8, found something else') from None
    except (OSError, ValueError) as error:
        raise InputError(f'{path}: cannot be read: {error}') from None


class _Loader(yaml.SafeLoader):
    """YAML as the ROS parser sees it: no anchors, and 6e6 is a number."""

    def compose_node(self, parent, index):
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()
            raise yaml.composer.ComposerError(
                None, None, 'ROS parameter files know no aliases, write the value again',
                event.start_mark)
        return super().compose_node(parent, index)


# PyYAML follows YAML 1.1, where 6e6 and 6.0e6 are text; for ROS and for people they are numbers.
_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$'),
    list('-+0123456789.'))


def _parse(text, path):
    loader = None
    try:
        loader = _Loader(text)
        root = loader.get_single_node()
        if not isinstance(root, yaml.MappingNode):
            raise InputError(
                f'{path}: expected "/**:" with "ros__parameters:" below it, found '
                f'{"nothing" if root is None else shown(text.strip(), 40)}; '
                'give a ROS 2 parameter file')
        return _plain(root, loader, path, 0)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f':{mark.line + 1}' if mark else ''
        raise InputError(f'{path}{place}: expected YAML: {error.problem}; mend the line') from None
    except yaml.YAMLError as error:
        raise InputError(f'{path}: expected YAML text: {error}') from None
    except (RecursionError, ValueError, OverflowError):
        raise InputError(f'{path}: expected YAML with plain values; give the right file') from None
    finally:
        if loader is not None:
            loader.dispose()


class _Section(dict):
    """A mapping of YAML that knows the line of each key."""

    def __init__(self):
        self.lines = {}


def _plain(node, loader, path, depth):
    """Return a YAML node as plain data; keys that stand twice are an error, not a surprise."""
    line = node.start_mark.line + 1
    if depth > DEEPEST:
        raise InputError(f'{path}:{line}: expected at most {DEEPEST} levels; give the right file')
    if not isinstance(node, yaml.MappingNode):
        return loader.construct_object(node, deep=True)
    section = _Section()
    for key_node, value_node in node.value:
        key = loader.construct_object(key_node, deep=True)
        line = key_node.start_mark.line + 1
        if not isinstance(key, str):
            raise InputError(f'{path}:{line}: {shown(key)}: expected a word as key; rename it')
        value = _plain(value_node, loader, path, depth + 1)
        if key in section:
            raise InputError(f'{path}:{line}: {key} = {shown(value)}: expected once, it stands '
                             f'in line {section.lines[key]} too; remove one')
        section[key], section.lines[key] = value, line
    return section


def _sections(tree, prefix, path):
    """Return [(node name, parameters)]; names nest as namespaces do."""
    found = []
    for key, value in tree.items():
        place = f'{path}:{tree.lines[key]}: {key}'
        if key != 'ros__parameters' and get_close_matches(key, ['ros__parameters'], cutoff=0.8):
            raise InputError(f'{place}: expected a node name or ros__parameters; '
                             'did you mean ros__parameters?')
        if not isinstance(value, _Section):
            raise InputError(f'{place} = {shown(value)}: expected "ros__parameters:" above the '
                             'parameters and keys below it; add it and indent them')
        if key == 'ros__parameters':
            found.append((prefix or '/**', value))
            continue
        below = _sections(value, f'{prefix}/{key}'.replace('//', '/'), path)
        if not below:
            raise InputError(f'{place}: expected "ros__parameters:" below the name of a node; '
                             'add it and indent the rest under it')
        found += below
    return found


def _matches(pattern, node):
    """Tell whether a section's name means this node, by ROS's rules for wildcards."""
    pattern = pattern if pattern.startswith('/') else f'/{pattern}'
    steps = re.escape(pattern).replace(r'/\*\*', '(/[^/]+)*').replace(r'\*', '[^/]+')
    return re.fullmatch(steps, node) is not None


def _flatten(section, prefix):
    """Yield (dotted name, value, line): `a.b: 1` and `a: {b: 1}` are the same parameter."""
    for key, value in section.items():
        if isinstance(value, _Section) and value:
            yield from _flatten(value, f'{prefix}{key}.')
        else:
            yield prefix + key, value, section.lines[key]
