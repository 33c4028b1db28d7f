# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The gap and where it lies, without causes: seconds instead of a minute."""

from __future__ import annotations

import numpy as np

from piezo_stack_sim.gap.measured import where
from piezo_stack_sim.gap.measured.evidence import noisier, prepare
from piezo_stack_sim.gap.measured.given import simulate_given
from piezo_stack_sim.gap.report_parts import gap_part, records_part
from piezo_stack_sim.plant import Device
from piezo_stack_sim.recording.finding import renewed
from piezo_stack_sim.recording.preflight import preflight
from piezo_stack_sim.recording.recording import RecordingSet


def compare_set(recordings: RecordingSet, device: Device) -> dict:
    """
    Return the gap of a recording set to a device and where it lies.

    Parameters
    ----------
    recordings : RecordingSet
        As read.
    device : Device
        The simulation.

    Returns
    -------
    dict
        ``gap``, ``where``, ``records`` and ``preflight`` as in ``diagnosis.json``.

    Raises
    ------
    InputError
        If preflight refuses everything.

    """
    from dataclasses import asdict

    checked, findings = preflight(recordings, device)
    checked, simulated, more = simulate_given(checked, device)
    evidence = prepare(checked.recordings, simulated)
    residual = np.concatenate([
        track.weighted(c, answer[c])
        for track, answer in zip(evidence.tracks, simulated) for c in track.channels])
    cuts = where.block_residuals(device, evidence, simulated)
    fractions, blocks = where.shares(cuts, None, evidence.channels)
    records, channels = where.by_record(evidence, residual)
    biggest = None
    if any(fractions.values()):
        biggest = max(fractions, key=lambda block: fractions[block])
    return {
        'name': recordings.name, 'gap': gap_part(evidence, simulated),
        'where': {'block': biggest, 'shares': fractions, 'blocks': blocks, 'channels': channels,
                  'records': records, 'bands': where.by_band(evidence, residual),
                  'regimes': where.by_regime(evidence, residual)},
        'records': records_part(evidence),
        'preflight': [asdict(f) for f in [*renewed(findings, more), *noisier(evidence)]]}
