# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From recordings to an actuator: the rising curve, the start, the joint fit, the intervals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.identify.certainty import Estimate, estimates, MOTION, unseen
from piezo_stack_sim.identify.last_element import let_last_slip, reaching_beyond
from piezo_stack_sim.identify.piecewise import Pieces
from piezo_stack_sim.identify.refine import descend, Fit, refine
from piezo_stack_sim.identify.rising import Curve
from piezo_stack_sim.identify.start import (
    check_signs, find_motion, find_pieces, find_polarised, first_actuator, guess_device,
    static_gains)
from piezo_stack_sim.identify.tracks import make_tracks
from piezo_stack_sim.identify.vector import Layout, PLACES
from piezo_stack_sim.plant.parameters import Actuator, Device
from piezo_stack_sim.plant.parameters.plausibility import implausible
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
    that did not begin relaxed, with the earlier peak voltage (V);
    ``started_from`` the model that gave what recordings do not show.
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

    @property
    def kept(self) -> list[str]:
        """Return the names of what is still what the identification started from."""
        return [each.name for each in self.estimates if each.kept]

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
    held: list[str] = []
    while True:
        fit = _joint_fit(layout, layout.vector(actuator), tracks, curves[0], held, told)
        certain = estimates(fit, held)
        found = fit.layout.actuator(fit.vector).replace(
            model=f'identified from {recordings.name}', relative_uncertainty=_uncertainty(certain),
            **{name: getattr(guess, name) for name in held})
        identified = _unloaded(device.replace(actuator=found), guess)
        more = unseen(certain)
        if not more and _moves_oddly(identified.actuator, guess):
            more = [name for name in MOTION if name not in held]
        if not more:
            break
        # Once more without what the first fit made of nothing: it shows in all that follows.
        held += more
    layout = fit.layout
    place = layout.size - len(layout.polarised)
    polarised = {tracks[i].recording.name: float(np.exp(fit.vector[place + j]))
                 for j, i in enumerate(layout.polarised)}
    return Identification(
        recordings.name, identified, certain, curves, pieces, fit,
        findings, polarised, guess.model)


def _joint_fit(layout: Layout, vector, tracks, curve: Curve, held, told) -> Fit:
    """
    Fit all recordings at once, from a first actuator whose last element sticks.

    The mass and the damping, as far as named in ``held``, stay those of the first actuator.
    """
    places = [PLACES[name] for name in held]

    def free(layout):
        return [j for j in range(layout.size) if j not in places]

    told('mass and damping')
    vector = find_motion(layout, vector, tracks, places)
    beyond = reaching_beyond(layout, vector, tracks, curve.span)
    # What an element that slips for the first time leaves behind looks like an earlier history.
    suspects = [track for i, track in enumerate(tracks) if i not in beyond or not curve.relaxed]
    layout, vector = find_polarised(layout, vector, suspects)
    beyond = [i for i in beyond if tracks[i].number not in layout.polarised]
    inside = [track for i, track in enumerate(tracks) if i not in beyond]
    if beyond and inside:
        vector = descend(layout, vector, inside, free(layout), steps=10, told=told)
        told('last element')
        layout, vector = let_last_slip(layout, vector, tracks, beyond, curve.span)
    vector = find_motion(layout, vector, tracks, places)
    return refine(layout, vector, tracks, told, free(layout))


def _moves_oddly(actuator: Actuator, guess: Actuator) -> bool:
    """Tell of an actuator that no stack is like, because of its mass or damping."""
    usual = actuator.replace(mass=guess.mass, damping=guess.damping)
    return bool(implausible(actuator) and not implausible(usual))


def _unloaded(device: Device, guess: Actuator) -> Device:
    """Return the device with what no stack weighs under its load, with its damping if need be."""
    found = device.actuator
    if found.mass <= HEAVIEST:
        return device
    load = replace(device.load, mass=device.load.mass + found.mass - guess.mass)
    found = found.replace(mass=guess.mass)
    if found.damping > guess.damping and implausible(found):
        load = replace(load, damping=load.damping + found.damping - guess.damping)
        found = found.replace(damping=guess.damping)
    return device.replace(actuator=found, load=load)


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
