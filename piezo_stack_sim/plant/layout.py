# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How the arrays of the compiled plant are laid out: names for columns and indices.

Symbols as in the paper: x displacement (m), w its velocity (m/s), q charge
(C), v_rc voltage of the Maxwell capacitor (V), T transformer ratio, C linear
capacitance.  ``p[i]`` is the block position q_bi of Eq. 16 (C) and
``r[i] = V_i C_i`` the charge at which element i breaks.

Columns of an *extended* row: states | q | v | inputs.  The inputs are u, F_ext,
a_rc, 1, a_friction, a_contact, smooth voltage, smooth force; the ideal stack
needs the first three, and only as many are worked with.

``memory`` (``x_block``) holds the position of the friction block (m), the
furthest charge since slip began (C), the present charge (C), the furthest
displacement since the guide slips (m), the current of late (A), by what part break
voltages have grown with it; and of the newest command by how much the charge
jumped (C), where to (C) and how long ago (s).

What is moved or watched is a product with a state: ``tables`` and ``watch`` hold their
matrices column by column, each filled up to whole lanes (:mod:`piezo_stack_sim.plant.lanes`).
"""

from piezo_stack_sim.plant.lanes import LANES, padded

(M_FRICTION, M_FURTHEST, M_CHARGE, M_SLIDE, M_CURRENT, M_GROWTH, M_JUMP, M_BEGAN,
 M_SINCE) = range(9)
N_MEMORY = 9

# Inputs, in the order of their columns.
U, FORCE, A_RC, ONE, A_FRICTION, A_CONTACT, SMOOTH_V, SMOOTH_F = range(8)
N_INPUTS = 8
N_RAMPS = 4  # slopes and curvatures of the two smooth inputs within a sub-step

# Outputs: reading of displacement, velocity, charge as measured, voltage, transduced force,
# charge on the stack, force through the joint to the load.
N_OUTPUTS = 7

# What is watched of a state: charge and its rate, the rate of charge that the source
# wants; where a longer sub-step is thought of, higher derivatives of charge and
# displacement; at the end of a row the outputs.  Each of the three begins a set of lanes.
W_Q, W_Q1, W_WANT = range(3)
W_Q2, W_Q3, W_X2, W_X3 = range(LANES, LANES + 4)
W_OUT = 2 * LANES
N_WATCHED = W_OUT + padded(N_OUTPUTS)

N_AHEAD = 3  # of them are known at the end of a sub-step together with the state

# Real parameters of the kernel.
(R_T, R_C, R_MASS, R_STIFFNESS, R_RESISTANCE, R_INTERNAL, R_LIMIT, R_SINK, R_FRICTION_K,
 R_FRICTION_F, R_GAP, R_CONTACT_K, R_V2, R_V3, R_K2, R_K3, R_OMEGA_EXTRA, R_RATE_MAX,
 R_TOL, R_DAMPING, R_OMEGA_FAST, R_QUICKEST, R_GROWTH, R_EXPONENT, R_SHARE, R_CONTACT_H,
 R_CONTACT_POWER, R_CONVERSE, R_KNEE, R_KNEE_SINK, R_RISE, R_CEILING, R_FLOOR) = range(33)
N_REAL = 33

# Integer parameters.
(I_DRIVE, I_QSTATE, I_FRICTION, I_CONTACT, I_LIMITER, I_SMOOTH, I_CLAMPED, I_SOURCE,
 I_INPUTS, I_RELAXING, I_GROWING) = range(11)
N_INT = 11

# Drives.
VOLTAGE, CHARGE = 0, 1

# Discrete state: slipping Maxwell elements and their direction, the same for
# friction, contact touched, limiter (one of those below).
F_SLIP, F_DIR, F_FRIC, F_FRIC_DIR, F_CONTACT, F_LIMIT = range(6)
N_FLAGS = 6

# The driver's current: as its resistance lets it, held at the limit, beyond the knee.  All
# are told by what the resistance alone would let flow.
FREE, SOURCED, SUNK, BENT_UP, BENT_DOWN = range(5)
N_LIMITS = 5

CHARGE_TOLERANCE = 1e-14  # C; a millionth of the smallest break charge of interest
DISPLACEMENT_TOLERANCE = 1e-15  # m
REST = 1e-12  # C; less than this to come (0.1 pm) is rest
GROWTH_STEP = 1e-7  # growth of break voltages below which they are left as they are
GROWTH_CURRENT = 1e-2  # A at which the growth is stated
GROWTH_MEMORY = 2.5e-4  # s, of the current that it follows: a sample at 4 kHz
MAX_EVENTS = 100000  # in one segment; a guard, never met by a finite input

# Space to work in: rows as wide as an extended state or what is watched, the last five
# for the algebra of a mode; and square matrices for its propagators.
(WORK_Z, WORK_Z1, WORK_END, WORK_HELD, WORK_NOW, WORK_THEN, WORK_BEND, WORK_SOURCE, WORK_Q, WORK_V,
 WORK_WANT, WORK_FLOW) = range(12)
N_ROWS = 12
N_MATRICES = 4
