# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Unit slips that no single value shows: ratios that every real stack keeps within bounds."""

import math

from piezo_stack_sim.plant.parameters.table import parameter_specs

# Each ratio is free of the stack's size, or nearly so; the bounds leave two decades and more on
# both sides of the stacks in data sheets, a slip of 1e3 or 1e6 falls outside.
_RATIOS = (
    ('open-lead resonance', 'Hz', 1e2, 1e7, ('mass', 'stiffness', 'linear_capacitance',
                                             'transformer_ratio')),
    ('T^2/(k C)', '', 0.02, 2e3, ('linear_capacitance', 'stiffness', 'transformer_ratio')),
    ('C times the sum of 1/C_i', '', 1e-3, 1e4, ('linear_capacitance', 'maxwell_stiffness')),
    ('damping ratio with open leads', '', 0.0, 10.0, ('damping', 'mass')),
    ('span of the voltage range', 'V', 1.0, 2e4, ('voltage_range',)),
)


def implausible(actuator):
    """
    Find a combination of values that no stack has.

    Parameters
    ----------
    actuator : Actuator
        With every value inside its own bounds.

    Returns
    -------
    tuple of (name, value, expected, mend), or None
        None for a plausible actuator.

    """
    values = _ratios(actuator)
    for (what, unit, lower, upper, causes), value in zip(_RATIOS, values):
        if not lower <= value <= upper:
            name, mend = _mend(actuator, causes)
            unit = f' {unit}' if unit else ''
            return (f'actuator.{name}', getattr(actuator, name),
                    f'expected {what} from {lower:g} to {upper:g}{unit}, got {value:.3g}', mend)
    return None


def _ratios(a):
    spring = a.stiffness + a.transformer_ratio**2 / a.linear_capacitance  # Eq. 20
    low, high = a.voltage_range
    return (
        math.sqrt(spring / a.mass) / (2.0 * math.pi),
        a.transformer_ratio**2 / (a.stiffness * a.linear_capacitance),
        a.linear_capacitance * sum(a.maxwell_stiffness),
        a.damping / (2.0 * math.sqrt(spring * a.mass)),
        high - low,
    )


def _mend(actuator, causes):
    """Try the known slips one by one: one that makes all ratios plausible is likely."""
    specs = parameter_specs()
    for name in causes:
        for unit, size in specs[f'actuator.{name}'].slips:
            value = getattr(actuator, name)
            scaled = tuple(v * size for v in value) if isinstance(value, tuple) else value * size
            changed = actuator.replace(**{name: scaled})
            if all(row[2] <= ratio <= row[3] for row, ratio in zip(_RATIOS, _ratios(changed))):
                text = [float(f'{v:.6g}') for v in scaled] if isinstance(value, tuple) \
                    else f'{scaled:.6g}'
                return name, f'it looks like {unit}; write {text}'
    units = ', '.join(f'{name} ({specs[f"actuator.{name}"].unit})' for name in causes)
    return causes[0], f'check the units of {units}'
