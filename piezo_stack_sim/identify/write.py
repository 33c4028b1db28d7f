# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""An identified actuator as a parameter file that says where its numbers come from."""

from __future__ import annotations

from piezo_stack_sim.identify.identification import Identification
from piezo_stack_sim.plant.parameters import device_from_mapping, save_device

UNITS = {
    'mass': 'kg', 'stiffness': 'N/m', 'damping': 'N s/m', 'linear_capacitance': 'F',
    'transformer_ratio': 'C/m', 'maxwell_stiffness': 'V/C', 'maxwell_break_voltage': 'V',
    'T/C': 'V/m', 'k + T^2/C': 'N/m', '1/C + maxwell_stiffness[-1]': 'V/C',
}


def unit_of(name: str) -> str:
    """Return the SI unit of an estimate."""
    return UNITS.get(name) or UNITS[name.partition('[')[0]]


def write_actuator(found: Identification, path) -> None:
    """
    Write an identified actuator as a ROS 2 parameter file, intervals in its head.

    Raises
    ------
    InputError
        If the numbers are no device's, or the file cannot be written.

    """
    device = device_from_mapping(found.device.to_mapping(), f'{found.name}, identified')
    save_device(device.rounded(), path, comment(found))


def comment(found: Identification) -> str:
    """Return the head of the file."""
    tracks = found.fit.tracks
    lines = [
        f'Identified by piezo_stack identify from the recordings {found.name}:',
        '  ' + ', '.join(track.recording.name for track in tracks) + '.',
        f'Rising curve: {", ".join(c.name for c in found.curves)}; '
        + ('from the relaxed state' if found.curves[0].relaxed else
           'half the branch after a reversal, for no recording began relaxed')
        + ('; displacement in place of charge.' if found.curves[0].proxy else '.'),
    ]
    for name, peak in found.polarised.items():
        lines.append(f'{name} did not begin relaxed: as after {peak:.3g} V and back.')
    lines += [
        f'What recordings do not show was taken from: {found.started_from}.',
        '', 'Estimates with 95 % intervals (SI units):',
    ]
    for each in found.estimates:
        if each.kept:
            lines.append(f'  {each.name} = {each.value:.6g} {unit_of(each.name)}   KEPT as it was '
                         'taken, NOT DETERMINED by these recordings')
            continue
        mark = '' if each.determined else '   NOT DETERMINED by these recordings'
        lines.append(f'  {each.name} = {each.value:.6g} [{each.low:.6g}, {each.high:.6g}] '
                     f'{unit_of(each.name)}{mark}')
    if found.device.load.mass > 0.0:
        also = f' and {found.device.load.damping:.4g} N s/m of the damping' \
            if found.device.load.damping > 0.0 else ''
        lines.append(f'  Of the moving mass {found.device.load.mass:.4g} kg{also} stand under '
                     'load: it is more than a stack has, or the start file said so.')
    if not found.fit.layout.last_slips:
        lines.append('  The last element never slips in these recordings: read it as a spring.')
    advice = dict.fromkeys(each.advice for each in found.undetermined)
    for line in advice:
        names = ', '.join(e.name for e in found.undetermined if e.advice == line)
        lines.append(f'To determine {names}: {line}.')
    lines += ['', 'Misfit (rms, share of the largest span of the channel):']
    for name, channel, rms, share in found.misfit():
        lines.append(f'  {name} {channel}: {rms:.3g} ({100.0 * share:.3g} %)')
    return '\n'.join(lines)
