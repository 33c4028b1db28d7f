# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Running ngspice, the circuit simulator, on a netlist of the device."""

from __future__ import annotations

from pathlib import Path
import shutil
import subprocess
import tempfile

import numpy as np

from piezo_stack_sim.plant.parameters import Device
from piezo_stack_sim.plant.spice import netlist


def available() -> bool:
    """Tell whether ngspice is installed (on Debian and Ubuntu the package of that name)."""
    return shutil.which('ngspice') is not None


def run(device: Device, time, command, external_force=None, drive: str = 'voltage', *,
        step: float = 1e-6, held: bool = True, timeout: float = 300.0) -> dict[str, np.ndarray]:
    """
    Let ngspice compute a device.

    Parameters
    ----------
    device, time, command, external_force, drive, step, held
        As `piezo_stack_sim.plant.spice.netlist` takes them.
    timeout : float
        Seconds after which ngspice is ended.

    Returns
    -------
    dict of ndarray, shape (n,)
        ``displacement`` (m), ``charge`` (C) and ``voltage`` (V) at ``time``.

    Raises
    ------
    RuntimeError
        If ngspice is not there, fails or writes nothing.

    """
    if not available():
        raise RuntimeError('ngspice is not installed')
    with tempfile.TemporaryDirectory(prefix='piezo_stack_') as folder:
        file = Path(folder, 'stack.cir')
        file.write_text(netlist(device, time, command, external_force, drive, step=step,
                                held=held, output='out.txt'), encoding='ascii')
        try:
            ended = subprocess.run(
                ['ngspice', '-b', file.name], cwd=folder, capture_output=True, text=True,
                errors='replace', timeout=timeout, check=False)
        except subprocess.TimeoutExpired:
            raise RuntimeError(f'ngspice did not end within {timeout:g} s') from None
        written = Path(folder, 'out.txt')
        if not written.is_file():
            lines = [line for line in ended.stderr.replace('\r', '\n').split('\n')
                     if line.strip() and 'Reference value' not in line]
            raise RuntimeError(f'ngspice wrote nothing: {" ".join(lines[-3:])}')
        table = np.loadtxt(written, ndmin=2)
    return {name: np.interp(time, table[:, 0], table[:, column])
            for column, name in enumerate(('displacement', 'charge', 'voltage'), 1)}
