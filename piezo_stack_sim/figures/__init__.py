# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The figures of the paper, simulated, each with the numbers that prove what it shows."""

from importlib import import_module

# In the order of the paper; a module is imported when its figure is drawn.
_HOME = {
    'figure_02': ('hysteresis', 'FIGURE'),
    'figure_03': ('charge', 'FIGURE'),
    'figure_04': ('stiffness', 'FIGURE'),
    'figure_07_08': ('maxwell', 'FIGURE'),
    'figure_10': ('triangles', 'FIGURE_10'),
    'figure_11': ('triangles', 'FIGURE_11'),
    'figure_12': ('decaying', 'FIGURE'),
    'figure_13': ('force', 'FIGURE'),
    'figure_14': ('resonance', 'FIGURE'),
}
IDS = tuple(_HOME)


def load(name):
    """Return the `Figure` of an id."""
    module, attribute = _HOME[name]
    return getattr(import_module(f'{__name__}.{module}'), attribute)
