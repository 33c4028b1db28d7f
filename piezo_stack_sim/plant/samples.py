# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What goes out of a device, and what it remembers."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

import numpy as np
from piezo_stack_sim.errors import InputError


@dataclass(frozen=True)
class Response:
    """
    What a device does: arrays of shape (n,), SI units.

    ``displacement`` (m) and ``charge`` (C) are the readings of the sensors,
    ``voltage`` (V) is at the terminals, ``velocity`` (m/s) of the moving end,
    ``force`` (N) the transduced force of Eq. 14.  Row k is sampled at
    ``time[k]`` (s), just before command k takes effect.
    """

    time: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    charge: np.ndarray
    voltage: np.ndarray
    force: np.ndarray
    charge_out_of_range: bool = False
    final_state: PlantState | None = None


@dataclass(frozen=True)
class Sample:
    """One row of a :class:`Response`; floats, SI units."""

    displacement: float
    velocity: float
    charge: float
    voltage: float
    force: float


@dataclass(frozen=True)
class PlantState:
    """
    Everything a device remembers; plain numbers, so that it can be saved.

    ``states`` are the continuous states by name, ``blocks`` the positions q_bi
    of Eq. 16 (C).
    """

    time: float
    drive: str
    states: dict[str, float]
    blocks: list[float]
    flags: list[int]
    inputs: list[float]
    memory: list[float]
    commands: list[float]
    readings: list[float]
    zero: list[float]
    out_of_range: bool
    noise: dict | None = None
    shown: list[float] = field(default_factory=list)

    def to_dict(self) -> dict:
        """Return the state as plain lists, numbers and names."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict) -> PlantState:
        """
        Read what :meth:`to_dict` wrote.

        Raises
        ------
        InputError
            If a key is missing or unknown.

        """
        try:
            return cls(**data)
        except TypeError as error:
            raise InputError(f'saved plant state: {error}; expected the keys of '
                             'PlantState.to_dict()') from None
