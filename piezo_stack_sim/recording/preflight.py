# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Preflight: what is wrong with recordings, named with file and row; mended where that is safe.

Nothing is silent: every repair, every oddity and every refusal is a Finding. Nothing is changed on
disk. What is refused is left out of the set; when nothing is left, InputError.
"""

from collections import defaultdict

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording import causality, magnitude, samples, sign, timing
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
    power of a thousand, unmistakably swapped signs, sensors that do not begin at zero, commands
    that were written beside what followed them. Left out:
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
    stages = _Stages(recording_set, strict)
    stages.run(lambda each: _measured(each, require_measured))
    for check in (
        samples.check_length, samples.check_numbers, timing.check_inputs_complete,
        timing.check_order, timing.check_unit, timing.check_grid, samples.check_missing,
        samples.check_length, samples.check_own,
    ):
        stages.run(check)
    told = {each.name: causality.shows_at_once(each) for each in stages.passed}
    stages.run(lambda each: causality.advance(each, told[each.name], told.values()))
    if device is None:
        stages.run(magnitude.check_limits)
        stages.run(lambda each: samples.check_alive(each, {}))
        stages.run(lambda each: samples.check_clipped(each, {}))
        stages.run(_starts(None))
    else:
        _against_the_device(stages, Statics(device))
    stages.run(lambda each: _measured(each, require_measured))
    stages.run(_copies(stages.passed))
    return stages.result()


class _Stages:
    """The recordings that have passed so far, and what was found on the way."""

    def __init__(self, recording_set, strict):
        self.set, self.strict = recording_set, strict
        self.passed = list(recording_set.recordings)
        self.findings = [each for recording in self.passed for each in recording.findings]
        self.refused = []

    def run(self, check):
        """Run a check over all recordings; one that is refused goes no further."""
        recordings, self.passed = self.passed, []
        for recording in recordings:
            try:
                recording, findings = check(recording)
            except RefusedError as error:
                if self.strict:
                    raise InputError(str(error)) from error
                self.refused.append(error.finding)
                continue
            self.findings += findings
            self.passed.append(recording)

    def result(self):
        """Return what preflight returns."""
        if not self.passed:
            more = f' (and {len(self.refused) - 1} more)' if len(self.refused) > 1 else ''
            raise InputError(f'{self.refused[0]}{more}')
        result = self.set.replace(recordings=tuple(self.passed), findings=())
        order = {each.source or each.name: k for k, each in enumerate(self.set.recordings)}
        # By recording, as they are read, and for each in the order of the checks.
        findings = sorted([*self.findings, *self.refused],
                          key=lambda each: order.get(each.file, -1))
        return result, [*self.set.findings, *findings, *_missing_channels(result)]


def _measured(recording, required):
    """Refuse a recording in which nothing was measured, or nothing is left of it."""
    if required and not recording.measured:
        raise refuse(recording, None, 'nothing was measured, or nothing usable, of '
                     f'{", ".join(MEASURED)}', 'map the channel, as in --map displacement=...')
    return recording, []


def _against_the_device(stages, statics):
    """Run the checks that compare with what the device should answer."""
    def answered(check):
        return lambda each: check(
            each, statics.answer(each.drive, each.command, each.external_force))

    stages.run(answered(samples.check_alive))
    stages.run(answered(magnitude.check_connected))
    factor = magnitude.arbitrary_factor(stages.passed, (
        statics.answer(each.drive, each.command, each.external_force) for each in stages.passed))
    stages.run(lambda each: magnitude.give_size(each, factor))
    before = {each.name: each for each in stages.passed}
    stages.run(lambda each: magnitude.check_units(each, statics))
    scaled = {each.name: magnitude.command_power(before[each.name], each)
              for each in stages.passed}
    # One power of ten for all the recordings of a drive whose command was scaled.
    found_powers = {drive: {scaled[each.name] for each in stages.passed
                            if each.drive == drive and scaled[each.name]}
                    for drive in ('voltage', 'charge')}
    stages.run(lambda each: (each, []) if scaled[each.name] else magnitude.same_units(
        each, found_powers.get(each.drive, ()), statics))
    alike = {each.name: sign.likeness(each, statics) for each in stages.passed}
    of_set = defaultdict(list)
    for channels in alike.values():
        for channel, (by_command, _) in channels.items():
            of_set[channel].append(by_command)
    stages.run(lambda each: sign.check_signs(
        each, alike[each.name], of_set, statics.lowest(each.drive)))
    stages.run(lambda each: magnitude.check_force(
        each, sign.force_effect(each, statics), statics))
    stages.run(lambda each: magnitude.check_range(each, statics))
    stages.run(answered(samples.check_clipped))
    stages.run(_starts(statics))


def _starts(statics):
    """Return the check of the first rows, against the device's range if it is known."""
    def check(recording):
        size = float(np.max(np.abs(recording.command)))
        if statics is not None and recording.command_name:
            size = max(size, statics.limit(recording.drive))
        recording, findings = samples.check_start(recording, size, statics)
        if not np.any(recording.command) and not np.any(recording.external_force):
            findings.append(found(recording, 0, NOTE, 'command and force are zero throughout',
                                  'it shows noise and drift only'))
        elif (recording.command_name and any(recording.start)
                and not np.ptp(recording.command) and not np.ptp(recording.external_force)):
            findings.append(found(recording, 0, NOTE, 'command and force stand still throughout',
                                  'it shows noise and drift only'))
        return recording, findings
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
