# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What of the recordings goes into ``diagnosis.json`` so that the report can draw them."""

import heapq
import math

import numpy as np

# 150 000 numbers of about 13 characters keep the file near 2 MB however many recordings there are
NUMBERS = 150_000
POINTS = 1500
DETAIL_POINTS = 1000
BINS_PER_DECADE = 40


def build_traces(recordings, before, after=None, noise=None,
                 points=POINTS, detail_points=DETAIL_POINTS):
    """
    Thin recordings and simulations out to what a reader can see, for ``diagnosis['traces']``.

    Parameters
    ----------
    recordings : sequence of Recording
        In the order in which the report shall show them.
    before, after : sequence of dict
        For each recording the simulated channels, ``{channel: (n,) array}`` in SI units at the
        recording's times: with the parameter file as given, and with ``corrected.yaml``. ``after``
        is None, or None for a recording, where nothing was switched on. A measured channel that is
        absent from ``before`` is left out.
    noise : dict, optional
        rms of the noise by channel; it becomes the level of white noise in the spectra.
    points, detail_points : int
        The most points a view may have; fewer where many recordings would make the file too large.

    Returns
    -------
    dict
        ``traces`` of ``diagnosis.json`` (see :mod:`piezo_stack_sim.gap.schema`): plain lists and
        floats, NaN as None.

    """
    after = [None] * len(recordings) if after is None else after
    wanted = sum(_series(recording) for recording in recordings) * (points + detail_points)
    shrink = min(1.0, NUMBERS / max(wanted, 1))
    points, detail_points = (max(50, int(n * shrink)) for n in (points, detail_points))
    return {'recordings': [
        _trace(recording, old, new or {}, noise or {}, points, detail_points)
        for recording, old, new in zip(recordings, before, after, strict=True)]}


def thin_out(signals, points):
    """
    Choose the rows that draw signals best with straight lines between them.

    A third of the rows is spread evenly, so that no stretch is left empty. Then the row farthest
    from the line drawn so far is added, again and again (Douglas and Peucker, 1973): peaks,
    corners and steps stay, and what is dropped lies near the line.

    Parameters
    ----------
    signals : (n, m) ndarray
        Each column scaled to about the same size; finite.
    points : int
        The most rows to keep.

    Returns
    -------
    (k,) ndarray of int
        Increasing, with the first and the last row and the extremes of every column.

    """
    rows = len(signals)
    if rows <= points:
        return np.arange(rows)
    extremes = np.concatenate([signals.argmin(axis=0), signals.argmax(axis=0)])
    even = np.linspace(0, rows - 1, max(2, points // 3)).astype(int)
    kept = np.unique([*even, *extremes]).tolist()
    heap = [_farthest(signals, first, last) for first, last in zip(kept, kept[1:])]
    heapq.heapify(heap)
    while len(kept) < points and heap[0][0] < 0:
        _, first, middle, last = heapq.heappop(heap)
        kept.append(middle)
        heapq.heappush(heap, _farthest(signals, first, middle))
        heapq.heappush(heap, _farthest(signals, middle, last))
    return np.sort(kept)


def residual_spectrum(time, residual):
    """
    Return frequency (Hz) and amplitude spectral density (unit/sqrt(Hz)) of a residual.

    Welch's estimate over at most eight segments, its power then averaged in bins of equal width on
    a logarithmic axis. Uneven rows are interpolated to the median rate first.

    """
    good = np.isfinite(residual)
    time, residual = time[good], residual[good]
    if len(time) < 16:
        return np.empty(0), np.empty(0)
    step = float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1] + 0.5 * step, step)
    frequency, power = _welch(np.interp(even, time, residual), step)
    place = np.floor(np.log10(frequency) * BINS_PER_DECADE).astype(int)
    place -= place[0]
    count = np.bincount(place)
    used = count > 0
    return (np.exp(np.bincount(place, np.log(frequency))[used] / count[used]),
            np.sqrt(np.bincount(place, power)[used] / count[used]))


def _welch(values, step):
    """Return frequencies above zero and the one-sided power density, without importing scipy."""
    length = max(16, 2 * len(values) // 9)
    pieces = np.lib.stride_tricks.sliding_window_view(values, length)[::length // 2]
    window = np.hanning(length + 1)[:-1]
    parts = np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * window, axis=1)
    power = 2.0 * step * np.mean(np.abs(parts) ** 2, axis=0) / np.sum(window ** 2)
    return np.fft.rfftfreq(length, step)[1:], power[1:]


def _series(recording):
    """Return how many series of numbers a view of the recording has."""
    commanded = recording.command_name is not None
    return 1 + commanded + recording.has_force + 3 * len(recording.measured)


def _trace(recording, before, after, noise, points, detail_points):
    channels = {name: (np.asarray(measured, float), np.asarray(before[name], float),
                       None if after.get(name) is None else np.asarray(after[name], float))
                for name, measured in recording.measured.items() if name in before}
    rows = len(recording.time)
    signals = _scaled(channels, rows)
    chosen = thin_out(signals, points)
    views = {'overview': {**_view(recording, channels, chosen),
                          'error': _left_out(recording.time, channels, chosen)}}
    if rows > len(chosen):
        first = _worst_stretch(channels, rows, detail_points)
        stretch = np.arange(first, min(rows, first + detail_points))
        views['detail'] = _view(recording, channels, stretch)
    return {'name': recording.name, 'drive': recording.drive, 'rows': rows, 'views': views,
            'spectra': {name: _spectrum(recording.time, *signals, noise.get(name))
                        for name, signals in channels.items()}}


def _scaled(channels, rows):
    """
    Return measured signals and residuals as columns of comparable size, gaps bridged.

    The residuals count a tenth: where they are nothing but noise they would take every row.

    """
    columns = []
    for measured, before, after in channels.values():
        for signal, weight in ((measured, 1.0), (before - measured, 0.1),
                               (None if after is None else after - measured, 0.1)):
            if signal is None:
                continue
            good = np.isfinite(signal)
            if not good.any():
                continue
            if not good.all():
                signal = np.interp(np.arange(rows), np.flatnonzero(good), signal[good])
            span = np.ptp(signal)
            if span > 0:
                columns.append((signal - signal[0]) * (weight / span))
    return np.stack(columns, axis=1) if columns else np.zeros((rows, 1))


def _farthest(signals, first, last):
    """Return the row between two kept ones that lies farthest from the line, for the heap."""
    if last - first < 2:
        return 0.0, first, first, last
    inside = signals[first + 1:last]
    place = np.arange(1, last - first)[:, None] / (last - first)
    line = signals[first] + place * (signals[last] - signals[first])
    distance = np.abs(inside - line).max(axis=1)
    row = int(distance.argmax())
    return -float(distance[row]), first, first + 1 + row, last


def _left_out(time, channels, kept):
    """Return how far the rows left out lie from the lines, as a fraction of the span."""
    errors = [0.0]
    for _, before, _ in channels.values():
        line = np.interp(time, time[kept], before[kept])
        errors.append(float(np.abs(line - before).max() / max(np.ptp(before), 1e-300)))
    return round(max(errors), 4)


def _worst_stretch(channels, rows, length):
    """Return the first row of the stretch in which the residuals before are largest."""
    power = np.zeros(rows)
    for measured, before, _ in channels.values():
        error = np.nan_to_num(measured - before)
        power += error ** 2 / max(float(np.mean(error ** 2)), np.finfo(float).tiny)
    if rows <= length:
        return 0
    total = np.concatenate(([0.0], np.cumsum(power)))
    return int(np.argmax(total[length:] - total[:-length]))


def _view(recording, channels, rows):
    return {
        'time': _plain(recording.time[rows]),
        'command': _plain(recording.command[rows]) if recording.command_name else None,
        'external_force': _plain(recording.external_force[rows]) if recording.has_force else None,
        'channels': {name: {'measured': _plain(measured[rows]),
                            'simulated_before': _plain(before[rows]),
                            'simulated_after': None if after is None else _plain(after[rows])}
                     for name, (measured, before, after) in channels.items()}}


def _spectrum(time, measured, before, after, noise):
    # A row that one of the two lacks is left out of both, so that they share their frequencies
    lost = 0.0 if after is None else 0.0 * after
    frequency, old = residual_spectrum(time, measured - before + lost)
    new = None if after is None else residual_spectrum(time, measured - after + 0.0 * before)[1]
    level = None
    if noise is not None and len(frequency):
        # White noise of that rms fills the band up to half the rate
        band = 0.5 / float(np.median(np.diff(time)))
        level = _plain(np.full(len(frequency), noise / math.sqrt(band)))
    return {'frequency': _plain(frequency, digits=4), 'before': _plain(old, digits=4),
            'after': None if new is None else _plain(new, digits=4), 'noise': level}


def _plain(values, digits=None):
    """Return a list for JSON: NaN as None, rounded to a millionth of the span or to digits."""
    values = np.asarray(values, float)
    finite = values[np.isfinite(values)]
    if digits is not None:
        return [float(f'{value:.{digits}g}') if math.isfinite(value) else None for value in values]
    span = float(np.ptp(finite)) if finite.size else 0.0
    if span > 0:
        values = np.round(values, 6 - math.floor(math.log10(span)))
    return [value if math.isfinite(value) else None for value in values.tolist()]
