# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A recording set and its simulation, as it was given: with what its recorder did taken into account.

Preflight mends what a file tells by itself; here is mended what only a simulation tells.
"""

from __future__ import annotations

import numpy as np
from piezo_stack_sim.gap.measured.arbitrary import sized
from piezo_stack_sim.gap.measured.forward import simulate_set
from piezo_stack_sim.gap.measured.monitor import without_offset
from piezo_stack_sim.gap.measured.read_back import without_noise
from piezo_stack_sim.gap.measured.succession import in_succession
from piezo_stack_sim.plant import Device
from piezo_stack_sim.recording.finding import Finding
from piezo_stack_sim.recording.recording import RecordingSet


def simulate_given(given: RecordingSet, device: Device
                   ) -> tuple[RecordingSet, list[dict[str, np.ndarray]], list[Finding]]:
    """
    Simulate a set as it was given, each recording after what was before it.

    Parameters
    ----------
    given : RecordingSet
        After preflight.
    device : Device
        The simulation.

    Returns
    -------
    given : RecordingSet
        With what was before each recording, inputs without the noise of what read them, the
        voltage without an offset that only its reading has, and arbitrary displacements given a
        size.
    simulated : list of dict
        Channel to (n,) array for each recording.
    findings : list of Finding
        What was before which, what was taken off an input or a voltage, and the size that
        displacements were given, which preflight had only guessed.

    """
    recordings, findings = given.recordings, []
    simulated = simulate_set(device, recordings)
    for mended in (without_noise, in_succession, without_offset):
        recordings, told = mended(recordings, device, simulated)
        if told:
            findings += told
            simulated = simulate_set(device, recordings)
    recordings, told = sized(recordings, simulated)
    return given.replace(recordings=recordings), simulated, findings + told
