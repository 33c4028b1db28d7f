# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A preload spring or flexure that the stack must stretch.

    k -> k + stiffness,  Eq. 15

The stroke falls to k_s/(k_s + stiffness), the natural frequency rises.

Look-alikes: ``sensor_gain``, ``transducer_ratio``: only a spring stiffens the
device against forces.  A flexure that grows stiffer the further it is bent is
the same as a spring beside ``stiffness_hardening``.  A capacitor C_s in series with
the stack, as of a Sawyer-Tower circuit, is the same as a spring of T^2/(C_s + C) and a
ratio and capacitance smaller by the factor 1 + C/C_s (Eqs. 11 and 14, with q/C_s taken
from the voltage): no channel tells it, only how far these are from the file, and whether there
are springs so soft.
Source: PI, at most a tenth of the stack's stiffness; 5 N/um take 9 to 12 % here.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, stiffness):
    """Add a spring to ground."""
    model.k += stiffness


EFFECT = Effect(
    'parallel_stiffness', 'mechanical',
    'A spring beside the stack takes part of its stroke.',
    (
        Parameter('stiffness', 'N/m', 0.0, 0.0, 1e9, 5e6, 'stiffness of the spring'),
    ),
    apply, channels=('charge', 'displacement'),
    # A real flexure grows stiffer the further it is bent.
    form_like=('stiffness_hardening',))
