# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a recording must be to be played to anything: finite inputs, times that go on."""

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.finding import refuse, RefusedError
from piezo_stack_sim.recording.magnitude import (
    check_force, check_limits, check_range, check_reach)
from piezo_stack_sim.recording.statics import Statics
from piezo_stack_sim.recording.timing import check_scale


def require_finite(recording):
    """
    Refuse times, commands and forces that are no finite numbers.

    Raises
    ------
    InputError
        With the row; no limit holds such a number back, for it compares with none.

    """
    for name in ('time', 'command', 'external_force'):
        bad = np.flatnonzero(~np.isfinite(getattr(recording, name)))
        if bad.size:
            name = recording.command_name or name if name == 'command' else name
            raise InputError(str(refuse(
                recording, bad[0], f'{name} is no finite number',
                'fill it in or take the row out')))


def require_playable(recording):
    """
    Refuse what no device can be asked: inputs beyond any stack, times that do not go on.

    Raises
    ------
    InputError
        With the row and what to do.

    """
    require_finite(recording)
    try:
        check_limits(recording.replace(measured={}))
    except RefusedError as error:
        raise InputError(str(error)) from None
    back = np.flatnonzero(np.diff(recording.time) <= 0.0)
    if back.size:
        row = back[0] + 1
        raise InputError(str(refuse(
            recording, row, f'time {recording.time[row]:.9g} s does not come after '
            f'{recording.time[row - 1]:.9g} s',
            'sort the rows, or split the file between two runs')))


def check_played(recording, device):
    """
    Check the inputs of a recording against the device that they are played to, as preflight does.

    What was measured plays no part, so that nothing is turned or scaled but times since 1970.

    Parameters
    ----------
    recording : Recording
        After `require_playable`.
    device : Device
        That is to answer.

    Returns
    -------
    tuple of (Recording, list of Finding)

    Raises
    ------
    InputError
        With the row and what to do: a command far beyond the device, rows hardly in seconds.

    """
    statics, measured = Statics(device), recording.measured
    recording, findings = recording.replace(measured={}), []
    for check in (
        check_scale, lambda each: check_reach(each, statics),
        lambda each: check_force(each, {}, statics), lambda each: check_range(each, statics),
    ):
        try:
            recording, more = check(recording)
        except RefusedError as error:
            raise InputError(str(error)) from None
        findings += more
    return recording.replace(measured=measured), findings
