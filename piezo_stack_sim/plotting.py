# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The one style of every picture: figures, effect pages, reports, examples.

Pictures stay readable in greyscale (each line of the cycle has its own dash pattern and its own
lightness), carry units on their axes, and come out the same to the byte when drawn again. No
display and no pyplot state is involved: figures are plain objects on the Agg and SVG canvases.

    with plotting.style():
        figure, axes = plotting.new_figure(1, 2, height=2.6)
        plotting.plot(axes[0], time, displacement, x='time_ms', y='displacement', label='plant')
        plotting.save(figure, out / 'triangle')         # triangle.png and triangle.svg

"""

from __future__ import annotations

from contextlib import contextmanager
import io
import os
from pathlib import Path
from typing import Any, Iterator

from piezo_stack_sim.atomic import atomic_path

#: Axis label and factor from SI of every quantity that a picture shows.
QUANTITIES = {
    'time': ('Time (s)', 1.0),
    'time_ms': ('Time (ms)', 1e3),
    'frequency': ('Frequency (Hz)', 1.0),
    'frequency_khz': ('Frequency (kHz)', 1e-3),
    'displacement': ('Displacement (µm)', 1e6),
    'displacement_nm': ('Displacement (nm)', 1e9),
    'velocity': ('Velocity (mm/s)', 1e3),
    'charge': ('Charge (µC)', 1e6),
    'voltage': ('Voltage (V)', 1.0),
    'voltage_command': ('Voltage command (V)', 1.0),
    'charge_command': ('Charge command (µC)', 1e6),
    'force': ('Force (N)', 1.0),
    'external_force': ('External force (N)', 1.0),
    'stiffness': ('Stiffness (N/µm)', 1e-6),
    'impedance': ('Impedance (Ω)', 1.0),
    'phase': ('Phase (°)', 1.0),
    'gain': ('Gain (µm/µC)', 1.0),
}

#: Colour and dash pattern of line 0, 1, 2, ... from dark to light, so that grey keeps them apart.
LINES = (
    ('#111111', '-'),
    ('#a8223a', (0, (5, 2))),
    ('#3d8bd0', (0, (6, 1.6, 1.2, 1.6))),
    ('#4fae7e', (0, (1.4, 1.4))),
    ('#e39a2d', (0, (8, 2, 1.2, 2, 1.2, 2))),
    ('#b79ad6', (0, (3, 1))),
)
MARKERS = ('o', 's', '^', 'D', 'v', 'X')

WIDTH = 7.0  # inch, the width of a page's text
LEGEND_HEIGHT = 0.3  # inch, of a row of labels below a figure
RESOLUTION = 200  # dots an inch in PNG

_RC = {
    'font.family': 'DejaVu Sans',  # comes with matplotlib: the same on every machine
    'font.size': 9.0,
    'axes.titlesize': 9.5,
    'axes.titleweight': 'bold',
    'axes.titlelocation': 'left',
    'axes.labelsize': 9.0,
    'axes.linewidth': 0.7,
    'axes.grid': True,
    'axes.axisbelow': True,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'grid.color': '#d9d9d9',
    'grid.linewidth': 0.5,
    'lines.linewidth': 1.3,
    'lines.markersize': 4.0,
    'legend.fontsize': 8.0,
    'legend.framealpha': 0.9,
    'legend.edgecolor': '#cccccc',
    'legend.handlelength': 3.2,
    'xtick.labelsize': 8.0,
    'ytick.labelsize': 8.0,
    'xtick.direction': 'out',
    'ytick.direction': 'out',
    'figure.facecolor': 'white',
    'savefig.facecolor': 'white',
    'svg.fonttype': 'path',
    'svg.hashsalt': 'piezo_stack_sim',  # fixed ids: the same picture gives the same bytes
    'path.simplify': True,
    'path.simplify_threshold': 0.1,
    'agg.path.chunksize': 20000,
}


@contextmanager
def style() -> Iterator[None]:
    """Draw and save inside this context: it leaves the user's own style untouched."""
    import matplotlib
    from cycler import cycler

    cycle = cycler(color=[colour for colour, _ in LINES], linestyle=[dash for _, dash in LINES])
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({**_RC, 'axes.prop_cycle': cycle})
        yield


def new_figure(rows: int = 1, columns: int = 1, *, height: float = 2.8, width: float = WIDTH,
               **subplots: Any) -> tuple[Any, Any]:
    """
    Return a figure and its axes (an array when there are several), laid out without overlap.

    Parameters
    ----------
    rows, columns : int
        Grid of axes.
    height, width : float
        Size of the whole picture in inches.
    **subplots
        Passed to ``Figure.subplots``, e.g. ``sharex=True``, ``width_ratios=[2, 1]``.

    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout='constrained')
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, **subplots)


def line(index: int) -> dict[str, Any]:
    """Return colour and dash pattern number ``index``, for a line that must keep its look."""
    colour, dash = LINES[index % len(LINES)]
    return {'color': colour, 'linestyle': dash}


def marker(index: int) -> dict[str, Any]:
    """Return colour and marker number ``index``, for data drawn as points."""
    return {'color': LINES[index % len(LINES)][0], 'linestyle': 'none',
            'marker': MARKERS[index % len(MARKERS)], 'markerfacecolor': 'white'}


def label(axes: Any, x: str | None = None, y: str | None = None) -> None:
    """Write the name and the unit of a quantity of `QUANTITIES` on each given axis."""
    if x is not None:
        axes.set_xlabel(QUANTITIES[x][0])
    if y is not None:
        axes.set_ylabel(QUANTITIES[y][0])


def legend_above(axes: Any, columns: int = 4, title: str | None = None) -> None:
    """Put the legend above the axes, where it hides no data."""
    axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=columns, frameon=False,
                title=title, borderaxespad=0.2, columnspacing=1.4)


def legend_below(figure: Any) -> None:
    """Put one legend for all axes below them, each label once."""
    entries = {name: handle for axes in figure.axes
               for handle, name in zip(*axes.get_legend_handles_labels())}
    figure.legend(entries.values(), entries.keys(), loc='lower center', ncols=len(entries))
    # Not "outside lower center", which matplotlib has known since 3.7 only.
    share = LEGEND_HEIGHT / figure.get_size_inches()[1]
    figure.get_layout_engine().set(rect=(0.0, share, 1.0, 1.0 - share))


def plot(axes: Any, x_values: Any, y_values: Any, *, x: str, y: str, **options: Any) -> Any:
    """
    Plot SI arrays in the units of the picture and label both axes.

    Parameters
    ----------
    axes : matplotlib axes
        Where to draw.
    x_values, y_values : (n,) array_like
        In SI units.
    x, y : str
        Keys of `QUANTITIES`.
    **options
        Passed to ``axes.plot``; `line` and `marker` give looks.

    Returns
    -------
    matplotlib line

    """
    import numpy as np

    label(axes, x, y)
    return axes.plot(np.asarray(x_values) * QUANTITIES[x][1],
                     np.asarray(y_values) * QUANTITIES[y][1], **options)[0]


def render(figure: Any, suffix: str) -> bytes:
    """Return the picture as the bytes of a file; ``suffix`` is ``png`` or ``svg``."""
    buffer = io.BytesIO()
    metadata: dict[str, Any] = {'Date': None} if suffix == 'svg' else {'Software': None}
    figure.savefig(buffer, format=suffix, dpi=RESOLUTION, metadata=metadata)
    return buffer.getvalue()


def save(figure: Any, stem: str | os.PathLike[str],
         suffixes: tuple[str, ...] = ('png', 'svg')) -> list[Path]:
    """
    Write the picture as ``stem.png`` and ``stem.svg``, each whole or not at all.

    Parameters
    ----------
    figure : matplotlib figure
        What to save.
    stem : path
        Path without suffix; missing folders are made.
    suffixes : tuple of str
        Formats to write.

    Returns
    -------
    list of Path
        The files written.

    """
    base = Path(stem)
    written = []
    for suffix in suffixes:
        path = base.with_name(f'{base.name}.{suffix}')
        with atomic_path(path) as partial:
            partial.write_bytes(render(figure, suffix))
        written.append(path)
    return written
