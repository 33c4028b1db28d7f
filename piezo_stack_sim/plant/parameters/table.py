# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The declarative table of every parameter: names, types, units, bounds, defaults."""

from dataclasses import dataclass
from functools import cache
from importlib import import_module
import math

DRIVES = ('voltage', 'charge', 'open', 'shorted')
STEPPINGS = ('wall', 'lockstep')


@dataclass(frozen=True)
class ParameterSpec:
    """
    One parameter: a row of the table that files, commands and the node share.

    Bounds are those of a plausible stack (millimetres to 0.2 m, nanofarads to millifarads): wide
    enough for every real one, tight enough to notice a value in another unit.

    """

    name: str  # dotted, as ROS writes it
    kind: str  # 'double', 'doubles' (a list), 'integer', 'boolean', 'string'
    unit: str  # SI; '' for pure numbers and words
    description: str
    default: object = None  # None: the file must give it
    lower: float = -math.inf
    upper: float = math.inf
    zero: bool = False  # 0 is allowed besides lower..upper
    infinite_last: bool = False  # the last one of a list may be .inf
    length: int | None = None  # of a list, where it is fixed
    choices: tuple[str, ...] = ()
    read_only: bool = False  # cannot change while the node runs
    slips: tuple[tuple[str, float], ...] = ()  # (unit written by mistake, its size in SI)

    @property
    def required(self):
        """Whether a file must give this parameter."""
        return self.default is None

    @property
    def expected(self):
        """Say in words what a value must be."""
        if self.choices:
            return 'one of ' + ', '.join(self.choices)
        word = {
            'double': 'a number',
            'doubles': 'a list of numbers',
            'integer': 'a whole number',
            'boolean': 'true or false',
            'string': 'text',
        }[self.kind]
        if self.length is not None:
            word = f'a list of {self.length} numbers'
        if math.isfinite(self.lower) and math.isfinite(self.upper):
            word += f' from {self.lower:g} to {self.upper:g}'
        if self.unit:
            word += f' {self.unit}'
        if self.zero and self.lower > 0:
            word += ', or 0'
        return word


def _row(name, kind, unit, description, default=None, bounds=None, **rest):
    lower, upper = bounds or (-math.inf, math.inf)
    return ParameterSpec(
        name, kind, unit, description, default, float(lower), float(upper), **rest)


_ACTUATOR = (
    _row('actuator.model', 'string', '', 'Maker and type of the stack', read_only=True),
    _row('actuator.mass', 'double', 'kg', 'Effective moving mass m (Eq. 15)',
         bounds=(1e-6, 2.0), read_only=True, slips=(('g', 1e-3), ('mg', 1e-6))),
    _row('actuator.stiffness', 'double', 'N/m', 'Stiffness k at constant v_t (Eq. 15)',
         bounds=(1e4, 1e10), read_only=True,
         slips=(('N/um', 1e6), ('MN/m', 1e6), ('N/mm', 1e3))),
    _row('actuator.damping', 'double', 'N s/m', 'Damping b (Eq. 15)',
         bounds=(1e-4, 1e6), zero=True, read_only=True),
    _row('actuator.linear_capacitance', 'double', 'F',
         'Linear capacitance C in series with the Maxwell elements (Eq. 11)',
         bounds=(1e-10, 1e-2), read_only=True,
         slips=(('uF', 1e-6), ('nF', 1e-9), ('pF', 1e-12))),
    _row('actuator.transformer_ratio', 'double', 'C/m',
         'Electromechanical ratio T: charge per displacement, force per volt (Eqs. 11, 14)',
         bounds=(1e-3, 1e4), read_only=True, slips=(('uC/um', 1.0), ('mC/m', 1e-3))),
    _row('actuator.maxwell_stiffness', 'doubles', 'V/C',
         'Stiffness 1/C_i of each Maxwell element (Eq. 18)',
         bounds=(1e2, 1e12), read_only=True, slips=(('1e6 V/C', 1e6), ('1/uF', 1e6))),
    _row('actuator.maxwell_break_voltage', 'doubles', 'V',
         'Voltage V_i at which each Maxwell element slips (Eq. 19); .inf last: never',
         bounds=(1e-4, 1e4), infinite_last=True, read_only=True,
         slips=(('mV', 1e-3), ('kV', 1e3))),
    _row('actuator.voltage_range', 'doubles', 'V', 'Lowest and highest voltage allowed',
         bounds=(-1e4, 1e4), length=2, read_only=True, slips=(('kV', 1e3), ('mV', 1e-3))),
    _row('actuator.relative_uncertainty', 'double', '',
         'Relative scatter of one device about these values, as a fraction',
         default=0.02, bounds=(0.0, 0.5), read_only=True, slips=(('%', 0.01),)),
)

_LOAD = (
    _row('load.mass', 'double', 'kg', 'Mass moved by the stack', default=0.0,
         bounds=(0.0, 1e3), read_only=True),
    _row('load.damping', 'double', 'N s/m', 'Damping to ground', default=0.0,
         bounds=(0.0, 1e7), read_only=True),
    _row('load.stiffness', 'double', 'N/m', 'Spring to ground', default=0.0,
         bounds=(1e-3, 1e11), zero=True, read_only=True),
    _row('load.clamped', 'boolean', '', 'The stack cannot move at all', default=False,
         read_only=True),
)

_NOISE = tuple(
    row
    for quantity, unit, upper, slips in (
        ('displacement', 'm', 1e-5, (('nm', 1e-9), ('um', 1e-6))),
        ('charge', 'C', 1e-4, (('nC', 1e-9), ('uC', 1e-6))),
        ('voltage', 'V', 10.0, (('mV', 1e-3), ('uV', 1e-6))),
    )
    for row in (
        _row(f'noise.{quantity}', 'double', unit, f'RMS noise of the measured {quantity}',
             default=0.0, bounds=(0.0, upper), slips=slips),
        _row(f'noise.{quantity}_resolution', 'double', unit,
             f'Step of the measured {quantity}; 0 is continuous',
             default=0.0, bounds=(0.0, upper), slips=slips),
    )
) + (
    _row('noise.seed', 'integer', '', 'Seed of the noise', default=0,
         bounds=(0, 2**31 - 1), read_only=True),
)

_OPERATION = (
    _row('rate', 'double', 'Hz', 'Samples per second', default=1000.0, bounds=(10.0, 1e5),
         read_only=True, slips=(('kHz', 1e3), ('MHz', 1e6))),
    _row('drive', 'string', '', 'What the terminals are connected to', default='voltage',
         choices=DRIVES),
    _row('stepping', 'string', '', 'What advances the time', default='wall',
         choices=STEPPINGS, read_only=True),
    _row('command_timeout', 'double', 's',
         'Without a command for this long the last one is held and reported; 0 disables',
         default=0.0, bounds=(0.0, 60.0), slips=(('ms', 1e-3),)),
    _row('joint_name', 'string', '', 'Name of the joint in ~/state', default='stack',
         read_only=True),
    _row('hardware_id', 'string', '', 'hardware_id in /diagnostics; empty: the model',
         default='', read_only=True),
)


def _effect_rows():
    """Make the rows of every registered effect; with the defaults an effect is neutral."""
    registry = 'piezo_stack_sim.effects.registry'
    try:
        effects = import_module(registry).EFFECTS
    except ModuleNotFoundError as error:
        if error.name not in (registry, 'piezo_stack_sim.effects'):
            raise
        return ()
    return tuple(
        _row(f'effects.{effect.id}.{parameter.name}', 'double',
             '' if parameter.unit == '1' else parameter.unit,
             parameter.description, default=float(parameter.start),
             bounds=(parameter.lower, parameter.upper), read_only=not parameter.runtime)
        for effect in effects.values()
        for parameter in effect.parameters
    )


@cache
def parameter_specs():
    """
    Return the table of every parameter, effects included.

    Returns
    -------
    dict of str to ParameterSpec
        By dotted name, in the order in which a file lists them.

    """
    rows = _ACTUATOR + _LOAD + _effect_rows() + _NOISE + _OPERATION
    return {row.name: row for row in rows}
