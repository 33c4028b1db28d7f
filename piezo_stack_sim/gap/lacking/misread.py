# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Whether one channel alone was measured wrong: without it, nothing is wrong.

The nominal parameters are re-tuned to all channels together, so that a channel that lies makes
the others wrong as well.  To be asked where nothing else tells the block: a spring, too, can pass
for other nominal parameters as long as nobody listens to the charge.

A voltage that is wrong drives what lies behind the terminals; one that was measured wrong does
not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.fit import Fitter
from piezo_stack_sim.gap.fitting.lens import plain
from piezo_stack_sim.gap.lacking.back_coupling import (
    MISREAD_CHARGE, ratio_of_sums, Suspect, suspect_block)
from piezo_stack_sim.gap.measured.forward import simulate_set, spans
from piezo_stack_sim.gap.measured.voltage import MeasuredVoltage
from piezo_stack_sim.gap.measured.where import block_residuals, without_driver

WRONG = 0.2  # power beyond that of the noise from which the displacement has a gap
STAYS = 0.1  # part of it that may stay without the charge
PARTS = 20  # of all rows, by which the error of what follows is known
FOLLOWED = 0.35  # part, its error included, by which nothing follows what was read of a voltage


def suspect_charge(fitter: Fitter, cuts: Sequence[dict]) -> Suspect | None:
    """
    Return the sensor if the displacement is right once the charge is not listened to, or None.

    Parameters
    ----------
    fitter : Fitter
        Of the set.
    cuts : sequence of dict
        Of each track, from :func:`~piezo_stack_sim.gap.measured.where.block_residuals`, re-tuned
        to all channels.

    """
    evidence = fitter.evidence
    before = _gap(cuts)
    if before is None or before < WRONG:
        return None
    charge = np.concatenate([np.full(where.stop - where.start, channel == 'charge')
                             for (_, channel), where in zip(evidence.keys, spans(evidence))])
    deaf = fitter.through(plain(fitter.rows[~charge[fitter.rows]]))
    tuned = fitter.device_with({}, deaf.fit({}).phi)
    without = block_residuals(tuned, evidence, simulate_set(
        tuned, [track.recording for track in evidence.tracks]))
    after = _gap(without)
    right = after is not None and after < max(STAYS * before, STAYS)
    return MISREAD_CHARGE if right and suspect_block(without) is MISREAD_CHARGE else None


def is_voltage_misread(fitter: Fitter) -> bool:
    """
    Tell whether charge and displacement do not follow what is wrong with the measured voltage.

    They are regressed on what it would do to them, beside the nominal parameters as they are
    without it.

    Parameters
    ----------
    fitter : Fitter
        Of the set.

    """
    evidence = fitter.evidence
    others = np.concatenate([np.full(where.stop - where.start, channel != 'voltage')
                             for (_, channel), where in zip(evidence.keys, spans(evidence))])
    deaf = fitter.through(plain(fitter.rows[others[fitter.rows]]))
    tuned = deaf.fit({})
    device = deaf.device_with({}, tuned.phi)

    def driven(track):
        if track.recording.drive != 'voltage' or 'voltage' not in track.measured:
            return None
        read = MeasuredVoltage.of(track, device)
        return [voltage.answer_of(without_driver(device))
                for voltage in (read, replace(read, missed=np.zeros_like(read.missed)))]

    answers = parallel(driven, evidence.tracks)
    change = np.zeros(others.size)
    for (i, channel), where in zip(evidence.keys, spans(evidence)):
        if answers[i] is not None and channel != 'voltage':
            change[where] = np.subtract(*(evidence.tracks[i].weighted(channel, answer[channel])
                                          for answer in answers[i]))
    would = deaf.cleared(change[:, None], tuned)[:, 0]
    follows, error = ratio_of_sums(np.array([
        (part @ left, part @ part) for part, left in zip(
            np.array_split(-would, PARTS), np.array_split(deaf.view(tuned).left, PARTS))]))
    return follows + 2.0 * error < FOLLOWED


def _gap(cuts: Sequence[dict]) -> float | None:
    """Return the power of the displacement's gap beyond that of the noise, if charge is known."""
    powers = [float(np.mean(wrong ** 2)) / noise ** 2
              for wrong, noise in (cut['through'] for cut in cuts if 'through' in cut)]
    return float(np.mean(powers)) - 1.0 if powers else None
