# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The stack and what hangs on it, as numbers: one named tuple that the compiled integrator reads.

Every field beyond Tables 1 and 2 belongs to one hidden effect and is neutral by default.

"""

from typing import NamedTuple

import numpy as np

from piezo_stack_sim.challenge.guide import MEMBERS

#: Table 2 of the paper: stiffness 1/C_i (V/C) and break voltage (V) of the Maxwell elements.
TABLE_2_STIFFNESS = (2.0e6, 0.6e6, 0.3e6, 0.26e6, 0.06e6, 0.1e6, 0.05e6, 0.03e6, 0.1e6, 0.5e6)
TABLE_2_BREAK_VOLTAGE = (0.2, 0.3, 0.3, 2.6, 0.9, 2.0, 1.5, 1.2, 7.0, 80.0)


class Stack(NamedTuple):
    """Amplifier dynamics, stack and mechanics; SI units."""

    # Table 1
    m: float = 0.00375  # kg
    k: float = 6.0e6  # N/m
    b: float = 150.0  # N s/m
    C: float = 1.2e-6  # F
    T: float = 10.0  # N/V = C/m
    # Table 2
    K: np.ndarray = np.array(TABLE_2_STIFFNESS)  # V/C
    V: np.ndarray = np.array(TABLE_2_BREAK_VOLTAGE)  # V

    # Amplifier: a pole ahead of the output, an output resistance that falls once the current
    # exceeds the quiescent one (class AB), a limit of the current (see the module of the stage),
    # and an inductive output filter that may ring.
    amplifier_lag: float = 0.0  # s
    output_resistance: float = 0.0  # Ohm
    quiescent_current: float = np.inf  # A
    current_limit: float = np.inf  # A
    sink_share: float = 1.0  # of the current limit, when discharging
    stage_first: float = 0.0
    stage_second: float = 0.0
    stage_third: float = 1.0  # s
    ringing_frequency: float = 0.0  # Hz, 0 is none
    ringing_damping: float = 0.1
    crossover_voltage: float = 0.0  # V, of a class B output
    crossover_current: float = 2e-4  # A

    # Creep: charge that follows with the logarithm of time.
    creep_per_decade: float = 0.0
    creep_onset: float = 1e-3  # s
    # Break voltages that grow with the logarithm of the current.
    rate_gain: float = 0.0
    rate_reference: float = 2e-3  # A
    rate_memory: float = 1e-4  # s
    # Rising and falling branches differ; an exponential restoring voltage on top.
    branch_difference: float = 0.0
    bow_stiffness: float = 0.0  # V/C
    bow_charge: float = 1e-4  # C
    # A series capacitor for charge measurement that nobody mentioned.
    sense_elastance: float = 0.0  # V/C
    # One Preisach relay: a domain wall that jumps at one voltage and returns at another.
    relay_charge: float = 0.0  # C
    relay_on: float = 60.0  # V
    relay_off: float = 20.0  # V
    relay_time: float = 2e-3  # s

    # Transducer: converse and direct effect differ (no reciprocity), electrostriction, heating.
    converse_error: float = 0.0
    direct_error: float = 0.0
    depoling_force: float = np.inf  # N, a pressure that doubles the converse error
    electrostriction: float = 0.0  # N/C^2
    chord_charge: float = 0.0  # C at which its force vanishes again
    heating_gain: float = 0.0
    heating_current: float = 0.02  # A
    heating_time: float = 0.5  # s

    # Mechanics
    spring_stiffness: float = 0.0  # N/m, progressive preload spring
    spring_length: float = 5e-5  # m
    hardening_force: float = 0.0  # N at hardening_reference
    hardening_reference: float = 1.2e-5  # m
    hardening_power: float = 4.0
    # The guide of the moving part: see its module.
    guide_first: np.ndarray = np.zeros(MEMBERS)
    guide_second: np.ndarray = np.ones(MEMBERS)
    guide_third: float = 0.0
    hertz_stiffness: float = 0.0  # N/m^1.5
    hertz_gap: float = 1.0  # m
    hertz_roughness: float = 1e-9  # m
    # The mount beside the stack: see its module, which makes its branches of these.
    mount_stiffness: float = 0.0  # N/m that it can lose
    mount_first: float = 10.0  # s
    mount_second: float = 0.2
    mount_third: float = 1.0  # m
    detent_force: float = 0.0  # N
    detent_pitch: float = 2e-6  # m
    yielding_stiffness: float = 0.0  # N/m that a disc spring gives back beyond a place
    yielding_place: float = 5e-6  # m
    yielding_width: float = 5e-7  # m
    # A payload on the moving end, by a joint that is stiff but not rigid.
    body_mass: float = 0.0  # kg
    body_stiffness: float = 0.0  # N/m
    body_damping: float = 0.0  # N s/m
    body_slips: float = 0.75  # part of the stiffness that slips when stretched
    body_slip: float = 1e-8  # m; so far stretched half of that is gone
