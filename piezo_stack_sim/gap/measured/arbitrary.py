# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Displacements in units of their own: of the size of the simulated ones, and free in size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from piezo_stack_sim.recording.finding import Finding
from piezo_stack_sim.recording.magnitude import arbitrary_factor, give_size
from piezo_stack_sim.recording.recording import Recording


def is_arbitrary(recordings: Sequence[Recording]) -> bool:
    """Tell whether the scale of the displacement means nothing in any of the recordings."""
    return any(each.arbitrary for each in recordings)


def sized(recordings: Sequence[Recording], simulated: Sequence[dict[str, np.ndarray]]
          ) -> tuple[tuple[Recording, ...], list[Finding]]:
    """
    Scale arbitrary displacements, all alike, so that they move as far as the simulated ones.

    Parameters
    ----------
    recordings : sequence of Recording
        After preflight.
    simulated : sequence of dict
        Channel to (n,) array for each of them.

    Returns
    -------
    recordings : tuple of Recording
        Those whose displacement is in metres stay as they are.
    findings : list of Finding
        By what the others are multiplied now, all in all.

    """
    factor = arbitrary_factor(recordings, simulated)
    given = [give_size(each, factor) for each in recordings]
    return tuple(each for each, _ in given), [finding for _, told in given for finding in told]
