# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From recordings to an actuator: the rising curve, the start, the joint fit, the intervals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.identify.certainty import Estimate, estimates
from piezo_stack_sim.identify.last_element import let_last_slip, reaching_beyond
from piezo_stack_sim.identify.piecewise import Pieces
from piezo_stack_sim.identify.refine import descend, Fit, refine
from piezo_stack_sim.identify.rising import Curve
from piezo_stack_sim.identify.start import (
    check_signs, find_motion, find_pieces, find_polarised, first_actuator, guess_device,
    static_gains)
from piezo_stack_sim.identify.tracks import make_tracks
from piezo_stack_sim.identify.vector import Layout
from piezo_stack_sim.plant.parameters import Device
from piezo_stack_sim.recording.finding import Finding
from piezo_stack_sim.recording.magnitude import check_amplified
from piezo_stack_sim.recording.preflight import preflight
from piezo_stack_sim.recording.recording import RecordingSet

HEAVIEST = 1.0  # kg; what moves more carries a load
SURE, GUESSED = 0.02, 0.3  # relative uncertainty that a file with identified numbers states


@dataclass(frozen=True)
class Identification:
    """
    An identified actuator and how it was found.

    ``device`` is ready to be saved; ``estimates`` the parameters with their
    intervals; ``curves`` and ``pieces`` the paper's way; ``fit`` the joint
    fit; ``findings`` what preflight said; ``polarised`` names the recordings
    that did not begin relaxed, with the earlier peak voltage (V).
    """

    name: str
    device: Device
    estimates: list[Estimate]
    curves: list[Curve]
    pieces: Pieces
    fit: Fit
    findings: list[Finding]
    polarised: dict[str, float]
    started_from: str

    @property
    def undetermined(self) -> list[Estimate]:
        """Return the parameters that these recordings do not determine."""
        return [each for each in self.estimates if not each.determined]

    def misfit(self) -> list[tuple[str, str, float, float]]:
        """Return (recording, channel, rms misfit in SI units, share of the channel's span)."""
        spans = {}
        for track in self.fit.tracks:
            for channel, values in track.measured.items():
                spans[channel] = max(spans.get(channel, 0.0), float(np.ptp(values)))
        rows = []
        for track, rest in zip(self.fit.tracks, self.fit.misfits):
            for channel, values in rest.items():
                rms = float(np.sqrt(np.mean(values[track.used[channel]] ** 2)))
                rows.append((track.recording.name, channel, rms, rms / spans[channel]))
        return rows


def identify(recordings: RecordingSet, start: Device | None = None,
             elements: int | None = None, told=None) -> Identification:
    """
    Identify an actuator from recordings of it.

    Parameters
    ----------
    recordings : RecordingSet
        As read, before preflight.
    start : Device, optional
        What to believe of numbers that the recordings do not show; the paper's
        actuator if not given.
    elements : int, optional
        Number of Maxwell elements; as many as held-out points justify if not given.
    told : callable, optional
        Called with a line of progress now and then.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        If preflight refuses everything, something has the wrong sign and there is no start to
        tell, or no recording has a slow rise of the voltage.

    """
    told = told or (lambda line: None)
    # The size of a displacement in units of its own is that of the device one starts from.
    sizing = guess_device(start) if any(each.arbitrary for each in recordings) else start
    checked, findings = preflight(recordings, sizing)
    for each in checked:
        check_amplified(each)  # a parameter file of the amplifier and the stack would fit no stack
    check_signs(checked)
    originals = {each.name: each for each in recordings}
    tracks = make_tracks(checked.recordings, originals)
    if not tracks:
        raise InputError(f'{recordings.source or recordings.name}: no measured channel moves '
                         'beyond what the drive fixes: expected charge or displacement; record '
                         'one of them')
    kept = [track.recording for track in tracks]
    device = guess_device(start)
    guess = device.actuator
    gains = static_gains(kept)
    told('rising curve')
    charge_per_displacement = gains[0] or (
        guess.transformer_ratio + guess.stiffness * guess.linear_capacitance
        / guess.transformer_ratio)
    curves, pieces = find_pieces(kept, charge_per_displacement, elements)
    voltages = guess.voltage_range if start else _voltage_range(kept)
    actuator = first_actuator(pieces, gains, guess, voltages)
    device = device.replace(actuator=actuator)
    layout = Layout(device, len(actuator.maxwell_stiffness), False)
    told('mass and damping')
    vector = find_motion(layout, layout.vector(actuator), tracks)
    beyond = reaching_beyond(layout, vector, tracks, curves[0].span)
    # What an element that slips for the first time leaves behind looks like an earlier history.
    suspects = [track for i, track in enumerate(tracks)
                if i not in beyond or not curves[0].relaxed]
    layout, vector = find_polarised(layout, vector, suspects)
    beyond = [i for i in beyond if tracks[i].number not in layout.polarised]
    inside = [track for i, track in enumerate(tracks) if i not in beyond]
    if beyond and inside:
        vector = descend(layout, vector, inside, steps=10, told=told)
        told('last element')
        layout, vector = let_last_slip(layout, vector, tracks, beyond, curves[0].span)
    vector = find_motion(layout, vector, tracks)
    fit = refine(layout, vector, tracks, told)
    certain = estimates(fit)
    found = layout.actuator(fit.vector).replace(
        model=f'identified from {recordings.name}', relative_uncertainty=_uncertainty(certain))
    place = layout.size - len(layout.polarised)
    polarised = {tracks[i].recording.name: float(np.exp(fit.vector[place + j]))
                 for j, i in enumerate(layout.polarised)}
    device = device.replace(actuator=found)
    if found.mass > HEAVIEST:
        # No stack weighs that much: it carries something.
        load = replace(device.load, mass=device.load.mass + found.mass - guess.mass)
        device = device.replace(actuator=found.replace(mass=guess.mass), load=load)
    return Identification(
        recordings.name, device, certain, curves, pieces, fit,
        findings, polarised, guess.model)


def _uncertainty(certain: list[Estimate]) -> float:
    """
    Return how well the numbers are known: the median of their half intervals, relative.

    One number speaks for all. The widest would not: neighbouring Maxwell elements share a curve
    that is known far better than either of them.
    """
    widths = [each.half_width for each in certain if '/' not in each.name]
    return float(f'{min(max(float(np.median(widths)), SURE), GUESSED):.2g}')


def _voltage_range(recordings) -> tuple[float, float]:
    """Return the voltages (V) that the recordings cover, zero among them."""
    low, high = 0.0, 0.0
    for recording in recordings:
        values = recording.command if recording.drive == 'voltage' else \
            recording.measured.get('voltage')
        if values is not None:
            low, high = min(low, float(np.min(values))), max(high, float(np.max(values)))
    # Noise around zero is no range; neither are digits that nobody set.
    low = 0.0 if low > -0.02 * high else low
    return float(f'{low:.3g}'), float(f'{high:.3g}')
