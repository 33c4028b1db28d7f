# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a recording must be to be played to anything: finite inputs, times that go on."""

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.finding import refuse, RefusedError
from piezo_stack_sim.recording.magnitude import check_limits


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
