# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A driver that can deliver only so much current.

    -sink_share limit <= dq/dt <= limit

A current limit may set in little by little: beyond a ``knee``, part of either limit, the
resistance is 1 + ``rise`` times as large.

Steps become ramps, and sines of more than limit/(pi C V_pp) triangles.  Small
signals pass as the output resistance lets them: a limiter has at least 1 ohm behind it,
which is faster than any recording, and drivers have up to 5 ohm.

Look-alikes: ``amplifier_bandwidth`` (late at every amplitude): compare a small
step with a large one.
Source: data sheets of stack drivers, 50 mA to 3 A peak, cheap ones sink down to half of
what they source (engineering estimate); Fleming and Leang 2014.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, limit, sink_share, output_resistance, rise, knee):
    """Limit the current of the driver, which has some resistance of its own."""
    if model.drive == 'voltage':
        model.current_limit, model.sink_share = limit, sink_share
        model.knee, model.knee_rise = knee, 1.0 + rise
        model.output_resistance = max(model.output_resistance, output_resistance)


EFFECT = Effect(
    'amplifier_current_limit', 'drive',
    'The driver delivers at most a certain current, so that large fast changes become ramps.',
    (
        Parameter('limit', 'A', math.inf, 1e-3, 100.0, 0.1, 'largest current that it sources',
                  scale='log'),
        Parameter('sink_share', '1', 1.0, 0.3, 1.5, 0.8,
                  'largest current that it sinks, over that', magnitude=False),
        Parameter('output_resistance', 'ohm', 1.0, 1.0, 1e3, 2.0,
                  'resistance between driver and stack', magnitude=False),
        Parameter('rise', '1', 0.0, 0.0, 50.0, 1.0,
                  'more resistance close to a limit, over that far from it', magnitude=False,
                  tries=(1.0,)),
        Parameter('knee', '1', 0.6, 0.2, 0.95, 0.6,
                  'part of either limit from which it is more', magnitude=False, default=0.6,
                  late=True),
    ),
    apply, channels=('voltage', 'charge', 'displacement'))
