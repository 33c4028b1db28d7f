# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""A device as frozen data: the actuator, its load, its effects, its sensors, its operation."""

from dataclasses import asdict, dataclass, field, replace

from piezo_stack_sim.resources import config_file

DIGITS = 10  # of a number that was found from recordings; more nobody measures


@dataclass(frozen=True)
class Actuator:
    """The ``actuator`` section of a parameter file: the symbols of the paper in words."""

    model: str
    mass: float  # m, kg
    stiffness: float  # k, N/m
    damping: float  # b, N s/m
    linear_capacitance: float  # C, F
    transformer_ratio: float  # T, C/m = N/V
    maxwell_stiffness: tuple[float, ...]  # k_i = 1/C_i, V/C
    maxwell_break_voltage: tuple[float, ...]  # V_i, V; the last one may be inf
    voltage_range: tuple[float, float]  # V
    relative_uncertainty: float = 0.02

    def __post_init__(self):
        """Take any sequence for the lists, so that a device can be compared and hashed."""
        for name in ('maxwell_stiffness', 'maxwell_break_voltage', 'voltage_range'):
            object.__setattr__(self, name, tuple(float(v) for v in getattr(self, name)))

    @property
    def break_charges(self):
        """Charge V_i/k_i at which each element slips from the relaxed state, C (Eq. 9)."""
        pairs = zip(self.maxwell_break_voltage, self.maxwell_stiffness)
        return tuple(volt / stiffness for volt, stiffness in pairs)

    def replace(self, **changes):
        """Return a copy with other values."""
        return replace(self, **changes)


@dataclass(frozen=True)
class Load:
    """What the stack works against, fixed to ground on its far side."""

    mass: float = 0.0  # kg
    damping: float = 0.0  # N s/m
    stiffness: float = 0.0  # N/m
    clamped: bool = False  # no motion at all


@dataclass(frozen=True)
class Noise:
    """What the sensors add: rms noise and the step of the converter, 0 for none."""

    displacement: float = 0.0  # m
    displacement_resolution: float = 0.0  # m
    charge: float = 0.0  # C
    charge_resolution: float = 0.0  # C
    voltage: float = 0.0  # V
    voltage_resolution: float = 0.0  # V
    seed: int = 0


@dataclass(frozen=True)
class Device:
    """
    Everything that a parameter file says of one device.

    `effects` maps an effect's id to its parameters; an effect that is not named is neutral. Treat
    it as frozen: ask `with_effects` for a changed copy.

    """

    actuator: Actuator
    load: Load = Load()
    effects: dict = field(default_factory=dict, hash=False)
    noise: Noise = Noise()
    rate: float = 1000.0  # Hz
    drive: str = 'voltage'
    stepping: str = 'wall'
    command_timeout: float = 0.0  # s, 0 disables
    joint_name: str = 'stack'
    hardware_id: str = ''

    def __post_init__(self):
        """Own the effects, so that no caller's dictionary changes a device."""
        own = {name: dict(values) for name, values in self.effects.items()}
        object.__setattr__(self, 'effects', own)

    @classmethod
    def nominal(cls):
        """Return the NEC/TOKIN AE0505D16 of the paper: Tables 1 and 2 as printed."""
        from piezo_stack_sim.plant.parameters.file import load_device
        return load_device(config_file('ae0505d16.yaml'))

    def replace(self, **changes):
        """
        Return a copy with other values.

        `actuator`, `load` and `noise` may be given as a mapping of the fields to change.

        """
        for name in ('actuator', 'load', 'noise'):
            if isinstance(changes.get(name), dict):
                changes[name] = replace(getattr(self, name), **changes[name])
        return replace(self, **changes)

    def with_effects(self, effects):
        """Return a copy with these effects, ``{id: {parameter: value}}``, besides its own."""
        return replace(self, effects={**self.effects, **effects})

    def rounded(self):
        """Return a copy of which the stack, load and effects have ten significant digits."""
        def short(value):
            if isinstance(value, tuple):
                return tuple(map(short, value))
            return float(f'{value:.{DIGITS}g}') if isinstance(value, float) else value

        return self.replace(
            actuator={name: short(value) for name, value in asdict(self.actuator).items()},
            load={name: short(value) for name, value in asdict(self.load).items()},
            effects={name: {key: short(value) for key, value in values.items()}
                     for name, values in self.effects.items()})

    def to_mapping(self):
        """Return the sections and keys of a parameter file, as nested dictionaries."""
        return asdict(self)
