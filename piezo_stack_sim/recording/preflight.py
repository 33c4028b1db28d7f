"""
Preflight: what is wrong with recordings, named with file and row; mended where that is safe.

Nothing is silent: every repair, every oddity and every refusal is a Finding. Nothing is changed on
disk. What is refused is left out of the set; when nothing is left, InputError.
"""

from collections import defaultdict

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording import magnitude, samples, sign, timing
from piezo_stack_sim.recording.finding import Finding, found, NOTE, refuse, RefusedError
from piezo_stack_sim.recording.recording import MEASURED
from piezo_stack_sim.recording.statics import Statics

_MISSED = {
    'voltage': 'the drive cannot be told from what follows it',
    'charge': 'the electrical block cannot be told from the mechanical one',
    'displacement': 'nothing mechanical can be seen',
}


def preflight(recording_set, device=None, require_measured=True, strict=False):
    """
    Check recordings and mend what is safe to mend.

    Mended: rows that are there twice or out of order, a few lost rows or missing samples, times
    of arrival of a regular sampler, times since 1970, units that are wrong by an unmistakable
    power of a thousand, unmistakably swapped signs, sensors that do not begin at zero. Left out:
    channels that are dead or mostly missing, what follows a gap in which the commands are
    unknown. Refused: what cannot be mended safely.

    Parameters
    ----------
    recording_set : RecordingSet
        As it was read; it is not changed.
    device : Device, optional
        The nominal device, whose static answer tells units and signs. Without it only what no
        piezo stack can do is refused.
    require_measured : bool
        Refuse recordings in which nothing was measured.
    strict : bool
        Raise InputError for the first refusal, instead of leaving the recording out.

    Returns
    -------
    tuple of (RecordingSet, list of Finding)
        In the set, every array is finite and the times increase from zero.

    Raises
    ------
    InputError
        When no recording is left, or at the first refusal if `strict`.

    """
    findings = list(recording_set.findings)
    statics = None if device is None else Statics(device)
    passed, refused = [], []

    def attempt(recording, check):
        try:
            recording, more = check(recording)
            findings.extend(more)
            return recording
        except RefusedError as error:
            if strict:
                raise InputError(str(error)) from error
            findings.append(error.finding)
            refused.append(error.finding)
            return None

    for recording in recording_set.recordings:
        findings.extend(recording.findings)
        recording = attempt(recording, lambda each: _sizes_and_times(
            each, statics, require_measured))
        if recording is not None:
            passed.append(recording)
    if statics is not None:
        alike = {each.name: sign.likeness(each, statics) for each in passed}
        of_set = defaultdict(list)
        for channels in alike.values():
            for channel, (by_command, _) in channels.items():
                of_set[channel].append(by_command)
        passed = [attempt(each, lambda x: sign.check_signs(x, alike[x.name], of_set))
                  for each in passed]
    passed = [attempt(each, _starts(statics)) for each in passed if each is not None]
    passed = [attempt(each, _copies(passed)) for each in passed]
    passed = [each for each in passed if each is not None]
    if not passed:
        more = f' (and {len(refused) - 1} more)' if len(refused) > 1 else ''
        raise InputError(f'{refused[0]}{more}')
    result = recording_set.replace(recordings=tuple(passed), findings=())
    return result, [*findings, *_missing_channels(result)]


def _sizes_and_times(recording, statics, require_measured):
    """Run the checks of one recording that need no other one."""
    findings = []
    if require_measured and not recording.measured:
        raise refuse(recording, None, f'nothing was measured, none of {", ".join(MEASURED)}',
                     'map the channel, as in --map displacement=...')
    for check in (
        samples.check_length, samples.check_numbers, timing.check_inputs_complete,
        timing.check_order, timing.check_unit, timing.check_grid, samples.check_missing,
        samples.check_length,
    ):
        recording, more = check(recording)
        findings += more
    for check in _channel_checks(statics):
        recording, more = check(recording)
        findings += more
    if require_measured and not recording.measured:
        raise refuse(recording, None, 'no measured channel is usable',
                     '; '.join(each.what for each in findings))
    if not any(np.any(each) for each in (recording.command, recording.external_force)):
        findings.append(found(recording, 0, NOTE, 'command and force are zero throughout',
                              'it shows noise and drift only'))
    return recording, findings


def _channel_checks(statics):
    if statics is None:
        return (magnitude.check_limits, lambda each: samples.check_alive(each, {}),
                lambda each: samples.check_clipped(each, {}))

    def answered(check):
        return lambda each: check(
            each, statics.answer(each.drive, each.command, each.external_force))

    return (answered(samples.check_alive), answered(magnitude.check_connected),
            lambda each: magnitude.check_units(each, statics), answered(samples.check_clipped))


def _starts(statics):
    """Return the check of the first rows, against the device's range if it is known."""
    def check(recording):
        size = float(np.max(np.abs(recording.command)))
        if statics is not None and recording.drive in ('voltage', 'charge'):
            size = max(size, statics.voltage_limit if recording.drive == 'voltage'
                       else statics.charge_limit)
        return samples.check_start(recording, size)
    return check


def _copies(recordings):
    """Return the check that refuses a recording that another one of the set repeats."""
    def same(one, other):
        return one.drive == other.drive and one.columns().keys() == other.columns().keys() and all(
            np.array_equal(values, other.columns()[name])
            for name, values in one.columns().items())

    def check(recording):
        for other in recordings:
            if other is recording:
                return recording, []
            if other is not None and len(other) == len(recording) and same(recording, other):
                raise refuse(recording, None, f'a copy of {other.source or other.name}',
                             'it would count twice: remove one')
        return recording, []
    return check


def _missing_channels(recording_set):
    """Note channels that no recording has, or not every one."""
    findings, count = [], len(recording_set)
    for channel in MEASURED:
        having = [each.name for each in recording_set if channel in each.measured]
        if len(having) == count:
            continue
        what = f'no recording has {channel}' if not having else \
            f'{channel} is in {len(having)} of {count} recordings only'
        findings.append(Finding(recording_set.source or recording_set.name, None, NOTE, what,
                                '' if having else _MISSED[channel]))
    return findings
