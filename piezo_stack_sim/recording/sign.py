# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Preflight of signs: a channel, the force or the command wired the wrong way round.

A stack extends, takes charge and shows voltage in the direction of its command, and gives way to
a force. What moves the other way in slow motion is turned, never a fast motion, which may lag by
half a turn.
"""

import numpy as np

from piezo_stack_sim.recording.finding import found, refuse, REPAIRED

_SLOW_RATE = 500.0
_SURE = 0.7
_FEWEST_BLOCKS = 50


def _slowed(values, rate):
    """Average blocks of rows down to about 500 Hz, but keep at least 50 blocks."""
    block = max(1, min(int(rate / _SLOW_RATE), values.size // _FEWEST_BLOCKS))
    return values[:values.size // block * block].reshape(-1, block).mean(axis=1)


def _without(values, guide):
    """Take off a vector what a constant and a guide explain of it."""
    columns = np.column_stack([np.ones(values.size)] + ([guide] if guide is not None else []))
    return values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]


def _alike(values, guide, other):
    """Return the correlation of two vectors beyond what `other` explains; None if undefined."""
    if guide is None or np.ptp(guide) == 0.0:
        return None
    other = None if other is None or np.ptp(other) == 0.0 else other / np.ptp(other)
    # Scaled, for least squares over volts and metres at once.
    left = _without(values / (np.ptp(values) or 1.0), other)
    right = _without(guide / np.ptp(guide), other)
    size = np.sqrt(np.dot(left, left) * np.dot(right, right))
    return float(np.dot(left, right) / size) if size > 1e-9 * values.size else None


def likeness(recording, statics):
    """
    Compare each channel's slow motion with what command and force should do.

    Parameters
    ----------
    recording : Recording
        To look at; at least two rows.
    statics : Statics
        The device.

    Returns
    -------
    dict of str to (float or None, float or None)
        Correlation with the answer to the command, and to the force; None where it is undefined.

    """
    still = np.zeros(len(recording))
    rate = recording.rate
    by_command = statics.answer(recording.drive, recording.command, still)
    by_force = statics.answer(recording.drive, still, recording.external_force)
    alike = {}
    for channel, values in recording.measured.items():
        slow = [_slowed(x, rate) for x in (values, by_command[channel], by_force[channel])]
        alike[channel] = _alike(*slow), _alike(slow[0], slow[2], slow[1])
    return alike


def force_effect(recording, statics):
    """
    Compare how far the force moves each channel with how far it should.

    Returns
    -------
    dict of str to (float, float)
        The ratio, and the correlation beyond what the command explains.

    """
    still = np.zeros(len(recording))
    by_command = statics.answer(recording.drive, recording.command, still)
    by_force = statics.answer(recording.drive, still, recording.external_force)
    effect = {}
    for channel, values in recording.measured.items():
        slow = [_slowed(x, recording.rate)
                for x in (values, by_force[channel], by_command[channel])]
        alike = _alike(*slow)
        if alike is not None:
            other = None if np.ptp(slow[2]) == 0.0 else slow[2] / np.ptp(slow[2])
            sizes = [np.std(_without(each, other)) for each in slow[:2]]
            effect[channel] = (float(sizes[0] / sizes[1]) if min(sizes) > 0.0 else 1.0, alike)
    return effect


def falling(recording):
    """
    Tell what falls in slow motion while the command rises, and what while the force does.

    Returns
    -------
    tuple of (list of str, list of str)
        Channels that go surely against the command beyond what the force explains, and whether
        the displacement goes against the force.

    """
    def sure(channel, guide, other):
        slow = [_slowed(x, recording.rate) for x in (recording.measured[channel], guide, other)]
        return (_alike(*slow) or 0.0) < -_SURE

    command, force = recording.command, recording.external_force
    return ([each for each in recording.measured if sure(each, command, force)],
            [each for each in recording.measured
             if each == 'displacement' and sure(each, force, command)])


def _against(likenesses):
    """Return -1 when all that is sure is against, 1 when all is for, 0 when nothing is sure."""
    sure = {int(np.sign(each)) for each in likenesses if each is not None and abs(each) > _SURE}
    return sure.pop() if len(sure) == 1 else 0


def check_signs(recording, alike, of_set, lowest=-np.inf):
    """
    Turn what is unmistakably the wrong way round.

    Parameters
    ----------
    recording : Recording
        To check.
    alike : dict
        Its `likeness`.
    of_set : dict of str to list of float
        Correlations with the command over the whole set, for a recording without a command.
    lowest : float
        The lowest command that the device is made for.

    Returns
    -------
    tuple of (Recording, list of Finding)

    Raises
    ------
    RefusedError
        Something is the wrong way round, but nobody can tell what.

    """
    by_command = {name: _against([each[0]]) for name, each in alike.items()}
    turned = [name for name, sign in by_command.items() if sign < 0]
    # A command that never enters the range but would if it were turned.
    outside = np.max(recording.command) <= 0.0 and np.min(recording.command) < lowest
    if turned and (len(turned) > 1 or outside) and not any(x > 0 for x in by_command.values()):
        # All answers against one question: it is the question that is turned.
        recording, finding = _turn(recording, recording.command_name)
        return recording, [finding]
    findings = []
    for name in turned:
        recording, finding = _turn(recording, name)
        findings.append(finding)
    unsure = [name for name, sign in by_command.items() if not sign]
    by_force = {}
    for name, (_, force) in alike.items():
        sign = -1 if name in turned else 1
        if name in unsure and name in of_set:
            sign = _against(of_set[name]) or 1
        by_force[name] = sign * _against([force])
    wrong = [name for name, sign in by_force.items() if sign < 0]
    if not wrong:
        return recording, findings
    right = [name for name, sign in by_force.items() if sign > 0]
    known = [name for name in wrong if name not in unsure or _against(of_set.get(name, ()))]
    if not right and (known or len(wrong) > 1):
        recording, finding = _turn(recording, 'external_force')
        return recording, [*findings, finding]
    raise refuse(
        recording, None, f'{" and ".join(wrong)} moves against the external force',
        'one of them has the wrong sign: give it, as in --unit external_force=-1')


def _turn(recording, name):
    if name in recording.measured:
        changes = {'measured': {**recording.measured, name: -recording.measured[name]}}
    elif name == 'external_force':
        changes = {'external_force': -recording.external_force}
    else:
        changes = {'command': -recording.command}
    finding = found(recording, None, REPAIRED, f'{name} has the wrong sign', 'turned')
    return recording.replace(**changes), finding
