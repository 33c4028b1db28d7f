# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
From a device to the arrays of the kernel: one place where the wiring is done.

A :class:`Model` starts as the ideal stack of Eqs. 11 to 17.  Every effect that
is switched on adds its piece through the few verbs below (a linear state, a
term in one of the balances, a number changed, a memoryless map before or after
the stack), and :func:`assemble` lays the result out for the layout.  The model
knows nothing of single effects.

Signals that a linear term may use as a source: ``displacement`` (m),
``velocity`` (m/s), ``charge`` (C), ``voltage`` (V, at the terminals),
``command`` (V or C, after the drive's static part), ``external_force`` (N),
``one``, and the name of any state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
import math

import numpy as np

from piezo_stack_sim.plant import layout
from piezo_stack_sim.plant.reference import Reference

INSTANT = 1e-9  # s; a lag shorter than a fiftieth of a tick of the kernel is none
LIMITED = 1.0  # ohm behind a limited current at least; with a microfarad faster than any row


@dataclass
class Model:
    """
    A device being put together; the paper's symbols, SI units.

    Attributes
    ----------
    m, b, k, C, T : float
        Moving mass (kg), damping (N s/m), stiffness (N/m), linear capacitance
        (F) and transformer ratio (N/V), Table 1.
    maxwell_k, maxwell_v : numpy.ndarray, shape (n,)
        Stiffness (V/C) and break voltage (V) of the Maxwell elements, Table 2.
    reference : Reference
        Scales of the actuator before any effect changed it.
    converse_share : float
        Force per volt (Eq. 14) over charge per displacement (Eq. 11): 1 in a reciprocal stack.

    """

    m: float
    b: float
    k: float
    C: float
    T: float
    maxwell_k: np.ndarray
    maxwell_v: np.ndarray
    reference: Reference
    converse_share: float = 1.0
    drive: str = 'voltage'
    clamped: bool = False
    output_resistance: float = 0.0
    internal_resistance: float = 0.0
    current_limit: float = math.inf
    sink_share: float = 1.0
    knee: float = 1.0
    knee_rise: float = 1.0
    command_delay: float = 0.0
    sensor_delay: float = 0.0
    friction_stiffness: float = 0.0
    friction_force: float = 0.0
    contact_gap: float = math.inf
    contact_stiffness: float = 0.0
    contact_exponent: float = 1.0
    smooth_voltage: tuple[float, float] = (0.0, 0.0)
    smooth_force: tuple[float, float] = (0.0, 0.0)
    previous_voltages: tuple[float, ...] = ()
    strains: tuple[float, ...] = ()
    branch_difference: float = 0.0
    break_growth: float = 0.0
    break_growth_exponent: float = 1.0
    fast_rates: list[float] = field(default_factory=list)
    slow_rates: list[float] = field(default_factory=list)
    reading_lags: dict[str, complex] = field(default_factory=dict)
    command_maps: list[Callable] = field(default_factory=list)
    charge_maps: list[Callable] = field(default_factory=list)
    reading_maps: list[Callable] = field(default_factory=list)
    states: list[str] = field(default_factory=list)
    initial: dict[str, float] = field(default_factory=dict)
    rates: dict[str, dict[str, float]] = field(default_factory=dict)
    force_terms: dict[str, float] = field(default_factory=dict)
    voltage_terms: dict[str, float] = field(default_factory=dict)
    charge_terms: dict[str, float] = field(default_factory=dict)
    charge_reading_terms: dict[str, float] = field(default_factory=dict)
    charge_loss_terms: dict[str, float] = field(default_factory=dict)
    reading_terms: dict[str, float] = field(default_factory=lambda: {'displacement': 1.0})
    source_state: str | None = None
    load_mass: float = 0.0
    load_damping: float = 0.0
    load_stiffness: float = 0.0
    series_compliance: float = 0.0
    joint_terms: dict[str, float] = field(default_factory=dict)
    joint_maps: list[Callable] = field(default_factory=list)

    @property
    def settling(self) -> float:
        """Return the time constant (s) with which the charge follows a command, stack aside."""
        lag = 0.0
        if self.source_state is not None and self.drive in ('voltage', 'shorted'):
            lag = -1.0 / self.rates[self.source_state][self.source_state]
        elastance = float(np.sum(self.maxwell_k)) + 1.0 / self.C
        return lag + (self.output_resistance + self.internal_resistance) / elastance

    # -- verbs for the effects -------------------------------------------------

    def add_state(self, name: str, rate: Mapping[str, float], initial: float = 0.0) -> None:
        """Add a linear state whose derivative is the weighted sum ``rate`` of signals."""
        if name in self.rates:
            raise ValueError(f'the state {name!r} exists already')
        self.states.append(name)
        self.rates[name] = dict(rate)
        self.initial[name] = initial

    def add_force(self, terms: Mapping[str, float]) -> None:
        """Add forces (N) on the moving end, positive in the direction of extension."""
        _accumulate(self.force_terms, terms)

    def add_opposing_voltage(self, terms: Mapping[str, float]) -> None:
        """Add voltages (V) in series with the Maxwell capacitor (sources: states, charge)."""
        _accumulate(self.voltage_terms, terms)

    def add_reading(self, terms: Mapping[str, float]) -> None:
        """Add displacements (m) to what is read."""
        _accumulate(self.reading_terms, terms)

    def add_charge(self, terms: Mapping[str, float]) -> None:
        """
        Add charges (C, sources: states, charge) on the stack that pass no Maxwell element.

        A given charge counts them in: the Maxwell elements get the rest.
        """
        _accumulate(self.charge_terms, terms)

    def add_charge_reading(self, terms: Mapping[str, float]) -> None:
        """Add charges (C) that the charge measurement sees but the stack does not."""
        _accumulate(self.charge_reading_terms, terms)

    def lose_charge(self, terms: Mapping[str, float]) -> None:
        """Take charges (C, sources: states) from what a charge drive delivers to the stack."""
        _accumulate(self.charge_loss_terms, terms)

    def read_through(self, name: str, rate_constant: float) -> None:
        """Put a first-order lag of ``rate_constant`` (1/s) behind the reading, unless instant."""
        if rate_constant * INSTANT <= 1.0:
            self.reading_lags[name] = rate_constant

    def read_through_pair(self, name: str, rate_constant: complex) -> None:
        """Put two lags, of a complex ``rate_constant`` (1/s) and its conjugate, there likewise."""
        if abs(rate_constant) * INSTANT <= 1.0:
            self.reading_lags[name] = rate_constant

    def drive_through(self, name: str, rate_constant: float) -> None:
        """Put a first-order lag with ``rate_constant`` (1/s) between command and terminals."""
        if rate_constant * INSTANT > 1.0:
            return
        self.add_state(name, {'command': rate_constant, name: -rate_constant})
        self.source_state = name
        self.fast_rates.append(rate_constant)

    def map_command(self, function: Callable) -> None:
        """Pass the command through a memoryless function of an array (V -> V or C -> C)."""
        self.command_maps.append(function)

    def map_reading(self, function: Callable) -> None:
        """
        Pass the displacement through a memoryless function.

        It is called as ``function(reading, time)`` with arrays of equal shape (m, s since
        reset) and returns the new reading (m).
        """
        self.reading_maps.append(function)

    def map_charge(self, function: Callable) -> None:
        """
        Add a displacement to what the sensor is shown that follows the charge at once.

        It is called as ``function(charge)`` with an array (C on the stack, none in the relaxed
        one) and returns displacements (m) of equal shape.
        """
        self.charge_maps.append(function)

    def map_joint(self, function: Callable) -> None:
        """
        Add a displacement to what the sensor is shown that follows the force through the joint.

        It is called as ``function(force)`` with an array (N, pulling on the stack) and returns
        displacements (m) of equal shape.
        """
        self.joint_maps.append(function)


def _accumulate(terms: dict[str, float], more: Mapping[str, float]) -> None:
    for source, gain in more.items():
        terms[source] = terms.get(source, 0.0) + gain


def attach_load(model: Model) -> None:
    """
    Connect the load and the external force to the moving end (Eq. 15).

    Rigidly, or through ``series_compliance`` (m/N): then the force acts, the
    load moves and the displacement is read behind the compliance.
    """
    if model.series_compliance <= 0.0 or model.clamped:
        model.m += model.load_mass
        model.b += model.load_damping
        model.k += model.load_stiffness
        model.add_force({'external_force': 1.0})
        return
    joint = 1.0 / model.series_compliance
    if model.load_mass > 0.0:
        model.add_state('load_displacement', {'load_velocity': 1.0})
        model.add_state('load_velocity', {
            'displacement': joint / model.load_mass, 'external_force': 1.0 / model.load_mass,
            'load_displacement': -(joint + model.load_stiffness) / model.load_mass,
            'load_velocity': -model.load_damping / model.load_mass})
        model.slow_rates.append(math.sqrt((joint + model.load_stiffness) / model.load_mass))
        outer = {'load_displacement': 1.0}
    elif model.load_damping > 0.0:
        model.add_state('load_displacement', {
            'displacement': joint / model.load_damping,
            'external_force': 1.0 / model.load_damping,
            'load_displacement': -(joint + model.load_stiffness) / model.load_damping})
        model.fast_rates.append((joint + model.load_stiffness) / model.load_damping)
        outer = {'load_displacement': 1.0}
    else:
        total = joint + model.load_stiffness
        outer = {'displacement': joint / total, 'external_force': 1.0 / total}
    model.joint_terms = {source: joint * gain for source, gain in outer.items()}
    _accumulate(model.joint_terms, {'displacement': -joint})
    model.add_force(model.joint_terms)
    model.add_reading({'displacement': -1.0})
    model.add_reading(outer)


def attach_lags(model: Model) -> None:
    """Put the lags of the sensor behind all that it is shown, the load's joint included."""
    for name, rate_constant in model.reading_lags.items():
        if isinstance(rate_constant, complex):
            # One equation of second order: its states are real.
            square, velocity = abs(rate_constant) ** 2, f'{name}_velocity'
            terms = {source: gain * square for source, gain in model.reading_terms.items()}
            model.add_state(name, {velocity: 1.0})
            model.add_state(velocity, {**terms, name: -square,
                                       velocity: -2.0 * rate_constant.real})
        else:
            terms = {source: gain * rate_constant for source, gain in model.reading_terms.items()}
            model.add_state(name, {**terms, name: -rate_constant})
        model.reading_terms = {name: 1.0}


@dataclass(frozen=True)
class System:
    """The arrays of one device in one drive mode, as the kernel takes them."""

    state_names: tuple[str, ...]
    initial: np.ndarray
    k: np.ndarray
    v_break: np.ndarray
    r: np.ndarray
    real: np.ndarray
    ints: np.ndarray
    rates: np.ndarray
    opposing: np.ndarray
    reading: np.ndarray
    omega_max: float
    rate_max: float
    n_modes: int
    is_ideal: bool


def assemble(model: Model) -> System:
    """
    Lay a model out for the layout.

    Returns
    -------
    System
        Arrays in the layout that :mod:`piezo_stack_sim.plant.layout` describes.

    """
    attach_load(model)
    attach_lags(model)
    voltage_driven = model.drive in ('voltage', 'shorted')
    resistance = model.output_resistance + model.internal_resistance
    limited = math.isfinite(model.current_limit)
    if limited and voltage_driven and resistance < LIMITED:
        # A source behind a limiter needs some resistance to be causal, and less than this
        # would only have it chatter between the limit and none.
        model.output_resistance += LIMITED - resistance
        resistance = LIMITED
    elastance = (float(np.sum(model.maxwell_k)) + 1.0 / model.C
                 + abs(model.voltage_terms.get('charge', 0.0)))
    if limited:
        # Faster charging would drown in rounding what is left of a motion.
        missing = INSTANT * elastance - resistance
        model.output_resistance += max(0.0, missing)
        resistance += max(0.0, missing)
    charge_is_state = voltage_driven and (limited or resistance > INSTANT * elastance)

    names = ['displacement', 'velocity']
    if charge_is_state:
        names.append('charge')
    names += model.states
    n_states = len(names)
    width = n_states + 2 + layout.N_INPUTS
    column = {name: i for i, name in enumerate(names)}
    column['charge'] = n_states
    column['voltage'] = n_states + 1
    base = n_states + 2
    column['command'] = base + layout.U
    column['external_force'] = base + layout.FORCE
    column['one'] = base + layout.ONE
    if model.source_state is not None and not voltage_driven:
        model.source_state = None

    def row(terms: Mapping[str, float]) -> np.ndarray:
        out = np.zeros(width)
        for source, gain in terms.items():
            out[column[source]] += gain
        return out

    converse = model.converse_share * model.T
    # All charge on the stack, and that which passes the Maxwell elements for it at once.
    charge = row(model.charge_terms)
    charge[column['charge']] += 1.0
    share = charge[column['charge']]
    rates = np.zeros((n_states, width))
    if not model.clamped:
        rates[0, 1] = 1.0
        force = row(model.force_terms)
        force += converse / model.C * charge  # Eq. 14 with v_t = (q - T x)/C, Eq. 11
        force[0] -= model.k + converse * model.T / model.C
        force[1] -= model.b
        force[base + layout.A_FRICTION] += 1.0
        force[base + layout.A_CONTACT] += 1.0
        force[base + layout.SMOOTH_F] += 1.0
        rates[1] = force / model.m  # Eq. 15
    for name in model.states:
        rates[column[name]] = row(model.rates[name])

    opposing = np.zeros((2, n_states + 1))
    for source, gain in model.voltage_terms.items():
        opposing[0, n_states if source == 'charge' else column[source]] += gain
    for source, gain in model.charge_terms.items():
        opposing[0, n_states if source == 'charge' else column[source]] += gain / model.C
        if source != 'charge':
            opposing[1, column[source]] += gain / share
    for source, gain in model.charge_loss_terms.items():
        opposing[1, column[source]] += gain / share

    reading = np.zeros((layout.N_OUTPUTS, width))
    reading[0] = row(model.reading_terms)
    reading[1, 1] = 1.0
    reading[2] = charge + row(model.charge_reading_terms)
    reading[3, column['voltage']] = 1.0
    reading[4] = converse / model.C * charge
    reading[4, 0] -= converse * model.T / model.C
    reading[5] = charge
    reading[6] = row(model.joint_terms)

    k = np.ascontiguousarray(model.maxwell_k, dtype=float)
    v_break = np.ascontiguousarray(model.maxwell_v, dtype=float)
    r = v_break / k

    real = np.zeros(layout.N_REAL)
    real[layout.R_T] = model.T
    real[layout.R_CONVERSE] = converse
    real[layout.R_C] = model.C
    real[layout.R_MASS] = model.m
    real[layout.R_STIFFNESS] = model.k
    real[layout.R_DAMPING] = model.b
    # The Maxwell elements get a share of the current.
    real[layout.R_RESISTANCE] = share * model.output_resistance if charge_is_state else 0.0
    real[layout.R_INTERNAL] = share * model.internal_resistance if charge_is_state else 0.0
    real[layout.R_LIMIT] = model.current_limit / share if limited else 0.0
    real[layout.R_SINK] = real[layout.R_LIMIT] * model.sink_share
    # Only the driver's own resistance rises beyond the knee.
    own = model.output_resistance / resistance if limited and resistance > 0.0 else 0.0
    real[layout.R_RISE] = 1.0 + own * (model.knee_rise - 1.0)
    # Where nothing rises there is no knee to stop at.
    knee_share = model.knee if real[layout.R_RISE] > 1.0 else 1.0
    for side, knee, edge in ((layout.R_LIMIT, layout.R_KNEE, layout.R_CEILING),
                             (layout.R_SINK, layout.R_KNEE_SINK, layout.R_FLOOR)):
        real[knee] = knee_share * real[side]
        real[edge] = real[knee] + real[layout.R_RISE] * (real[side] - real[knee])
    real[layout.R_FRICTION_K] = model.friction_stiffness
    real[layout.R_FRICTION_F] = model.friction_force
    if math.isfinite(model.contact_gap):
        # A straight stop is exact; a power of the indentation is followed in small steps.
        straight = model.contact_exponent == 1.0
        real[layout.R_GAP] = model.contact_gap
        real[layout.R_CONTACT_K if straight else layout.R_CONTACT_H] = model.contact_stiffness
        real[layout.R_CONTACT_POWER] = model.contact_exponent
    real[layout.R_V2], real[layout.R_V3] = model.smooth_voltage
    real[layout.R_K2], real[layout.R_K3] = model.smooth_force
    real[layout.R_OMEGA_EXTRA] = min(model.slow_rates, default=0.0)
    real[layout.R_OMEGA_FAST] = max(model.slow_rates, default=0.0)
    real[layout.R_GROWTH] = model.break_growth
    real[layout.R_EXPONENT] = model.break_growth_exponent
    real[layout.R_SHARE] = share
    real[layout.R_TOL] = 1e-4  # V; 0.01 nm with the usual large-signal gain

    stiffest = (model.k + converse * model.T / model.C + model.friction_stiffness
                + real[layout.R_CONTACT_K])
    omega_max = max([math.sqrt(stiffest / model.m), *model.slow_rates])
    quickest = max(model.fast_rates, default=0.0)
    if charge_is_state:
        quickest = max(quickest, elastance / resistance)
        # The quicker the charge follows, the more its rate shows of what a port strays.
        real[layout.R_TOL] *= min(1.0, max(0.02, resistance / elastance / 1e-7))
    rate_max = max([omega_max, model.b / model.m, quickest,
                    *map(abs, model.reading_lags.values())])
    real[layout.R_QUICKEST] = quickest
    real[layout.R_RATE_MAX] = rate_max

    ints = np.zeros(layout.N_INT, dtype=np.int64)
    ints[layout.I_DRIVE] = layout.VOLTAGE if voltage_driven else layout.CHARGE
    ints[layout.I_QSTATE] = 2 if charge_is_state else -1
    ints[layout.I_FRICTION] = model.friction_force > 0.0 and model.friction_stiffness > 0.0
    ints[layout.I_CONTACT] = real[layout.R_CONTACT_K] > 0.0
    ints[layout.I_LIMITER] = limited and charge_is_state
    ints[layout.I_SMOOTH] = any((*model.smooth_voltage, *model.smooth_force,
                                 real[layout.R_CONTACT_H]))
    ints[layout.I_CLAMPED] = model.clamped
    ints[layout.I_GROWING] = model.break_growth != 0.0
    # What relaxes as fast as the end swings shows for a while after a jump.
    ints[layout.I_RELAXING] = quickest > 0.1 * omega_max
    # The ideal stack needs three inputs; the neutral rest is not worked with.
    used = np.flatnonzero(np.any(rates[:, base:] != 0.0, axis=0)
                          | np.any(reading[:, base:] != 0.0, axis=0))
    extra = [layout.SMOOTH_F] if ints[layout.I_SMOOTH] else []
    piecewise = (ints[layout.I_FRICTION] or ints[layout.I_CONTACT])
    extra += [layout.A_CONTACT] if piecewise else []
    extra += [layout.ONE] if ints[layout.I_LIMITER] else []
    used = [i for i in used if i <= layout.ONE]
    ints[layout.I_INPUTS] = max([layout.A_RC, *used, *extra]) + 1
    ints[layout.I_SOURCE] = -1 if model.source_state is None else column[model.source_state]

    # Two states, one port with memory, and what follows these: the fast kernel can take it.
    special = [layout.I_FRICTION, layout.I_CONTACT, layout.I_LIMITER, layout.I_SMOOTH,
               layout.I_GROWING]
    felt = opposing[0] if voltage_driven else opposing
    known = [layout.U, layout.FORCE, layout.ONE]
    others = np.delete(np.arange(width), [*range(base), *(base + i for i in known)])
    is_ideal = (not charge_is_state and model.source_state is None
                and not ints[special].any() and not felt.any()
                and not model.charge_terms and not model.joint_terms
                and set(model.force_terms) <= {'external_force'}
                and set(model.charge_reading_terms) <= set(model.states)
                and not rates[2:, others].any() and not reading[0, others].any())
    initial = np.array([model.initial.get(name, 0.0) for name in names])
    return System(tuple(names), initial, k, v_break, r, real, ints, rates, opposing, reading,
                  omega_max, rate_max, 4 * layout.N_LIMITS * (k.size + 1), is_ideal)
