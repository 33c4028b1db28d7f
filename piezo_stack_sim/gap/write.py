# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""A diagnosis as files: diagnosis.json, report.html, corrected.yaml."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
import shlex

from piezo_stack_sim.atomic import make_folder
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.gap.diagnose import diagnose_set
from piezo_stack_sim.gap.report import write_report
from piezo_stack_sim.gap.schema import validate
from piezo_stack_sim.gap.storage import write_diagnosis
from piezo_stack_sim.plant import load_device, save_device
from piezo_stack_sim.plant.compilation import compile_kernels
from piezo_stack_sim.recording.read import read_set

# Of half a million rows of six channels a diagnosis takes minutes, and one or two gigabytes.
MAX_VALUES = 3_000_000


def diagnose_to_folder(paths: Sequence[str], params: str, out: str, mapping=None, units=None,
                       progress: Callable[[str], None] = lambda message: None) -> dict:
    """
    Diagnose recordings and write what was found to a folder.

    Parameters
    ----------
    paths : sequence of str
        Recording sets or files of one device.
    params : str
        Parameter file.
    out : str
        Folder; made if missing.
    mapping, units : sequence of str, optional
        As :func:`piezo_stack_sim.recording.read.read_set` takes them.
    progress : callable
        Called with a sentence at every stage.

    Returns
    -------
    dict
        The diagnosis as written.

    Raises
    ------
    InputError
        For wrong recordings or a wrong parameter file.

    """
    device = load_device(params)
    progress('reading the recordings')
    recordings = read_set(list(paths), mapping=mapping, units=units, max_values=MAX_VALUES)
    if Path(params).resolve() == (Path(out) / 'corrected.yaml').resolve():
        raise InputError(f'--params {params}: would be written over; choose another --out')
    folder = make_folder(out)  # before minutes of work that would have nowhere to go
    progress('compiling the plant, once on a machine')
    compile_kernels()
    found = diagnose_set(recordings, device, progress)
    diagnosis, corrected = found.document, found.device
    diagnosis['how']['settings']['seconds'] = round(found.seconds, 1)
    diagnosis['how'] |= {'command': command_of(paths, params, out, mapping, units), **_version()}
    files = {name: str(folder / file) for name, file in (
        ('diagnosis', 'diagnosis.json'), ('report', 'report.html'),
        ('corrected', 'corrected.yaml'))}
    diagnosis['files'] = files
    diagnosis['inputs'] = {**inputs_of(paths, params, mapping, units),
                           'actuator': device.actuator.model}
    validate(diagnosis, files['diagnosis'])  # before anything that is there is written over
    on = ', '.join(diagnosis['selected']) or 'no effect'
    save_device(corrected, files['corrected'],
                f'{device.actuator.model} as diagnosed from {recordings.name}: '
                f'{diagnosis["verdict"]}, {on} switched on, nominal parameters re-tuned')
    write_report(diagnosis, files['report'])
    write_diagnosis(diagnosis, files['diagnosis'])
    return diagnosis


def command_of(paths: Sequence[str], params: str, out: str, mapping=None, units=None) -> str:
    """Return the command that makes a diagnosis once more, wherever it was asked for."""
    words = ['piezo_stack', 'diagnose', *map(str, paths), '--params', str(params),
             '--out', str(out)]
    for option, given in (('--map', mapping), ('--unit', units)):
        words += [word for each in given or () for word in (option, str(each))]
    return shlex.join(words)


def _version() -> dict[str, str]:
    """Return the version of the package as ``how`` has it; nothing where it is not installed."""
    try:
        return {'version': version('piezo_stack_sim')}
    except PackageNotFoundError:
        return {}


def inputs_of(paths: Sequence[str], params: str, mapping=None, units=None) -> dict:
    """Return what a diagnosis is made from, as it stands in diagnosis.json."""
    return {'sets': [str(path) for path in paths], 'params': str(params),
            'map': list(mapping or ()), 'unit': list(units or ())}
