# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The virtual actuator itself: parameters, model, kernel, analysis.  No ROS in here."""

import importlib

# Names are loaded when asked for, so that reading a parameter file does not load the compiler.
_HOME = {
    'Actuator': 'parameters', 'Device': 'parameters', 'Load': 'parameters',
    'Noise': 'parameters', 'device_from_mapping': 'parameters', 'load_device': 'parameters',
    'parameter_specs': 'parameters', 'save_device': 'parameters',
    'Plant': 'stack', 'PlantState': 'samples', 'Response': 'samples', 'Sample': 'samples',
    'replay': 'offline', 'simulate': 'offline', 'simulate_many': 'offline', 'Timeline': 'offline',
}

__all__ = sorted(_HOME)


def __getattr__(name):
    """Import a public name from its module on first use (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(importlib.import_module(f'{__name__}.{_HOME[name]}'), name)
