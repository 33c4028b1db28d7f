# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""No passive effect creates energy."""

from effect_probes import device, IDEAL, sine
import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.plant import simulate
import pytest

# A mode that is only read, and what a driver or a sensor does, carry no energy of the stack.
PASSIVE = ['transducer_ratio'] + [
    name for name, effect in EFFECTS.items()
    if effect.block in ('electrical', 'mechanical') and name != 'mechanical_resonance']


def work(response, voltage, force):
    """Return the work done on the device by source and force up to each row, in joules."""
    electrical = voltage[:-1] * np.diff(response.charge)  # the command holds from its row on
    mechanical = force[:-1] * np.diff(response.displacement)
    return np.concatenate([[0.0], np.cumsum(electrical + mechanical)])


@pytest.mark.parametrize('name', PASSIVE)
@pytest.mark.parametrize('strength', ['typical', 'upper', 'lower'])
def test_a_passive_effect_never_creates_energy(name, strength):
    values = {p.name: getattr(p, strength) if p.magnitude else p.typical
              for p in EFFECTS[name].parameters}
    if (name, strength) == ('asymmetric_hysteresis', 'lower'):
        values['cubic'] = -0.03  # both at their ends are refused
    target = IDEAL.with_effects({name: values}).replace(load={'mass': 0.01, 'stiffness': 1e6})
    random = np.random.default_rng(5)
    rows = 1500
    time = np.arange(rows) * 1e-4
    voltage = np.clip(np.cumsum(random.normal(0.0, 6.0, rows)), -40.0, 80.0)
    force = 60.0 * np.sin(2.0 * np.pi * 37.0 * time) + random.normal(0.0, 5.0, rows)
    energy = work(simulate(target, time, voltage, force), voltage, force)
    scale = np.ptp(energy)
    if name == 'initial_polarisation':
        return  # it starts with energy; the closed cycle below is its test
    assert energy.min() > -1e-6 * scale, 'a relaxed device cannot give energy away'


@pytest.mark.parametrize('name', PASSIVE)
def test_a_closed_cycle_only_loses_energy(name):
    time, voltage = sine(50.0, 0.0, 80.0, 6, 1000)
    force = -50.0 * (1.0 - np.cos(2.0 * np.pi * 50.0 * time + 1.0))
    energy = work(simulate(device(name), time, voltage, force), voltage, force)
    loss = energy[6000] - energy[5000]
    assert 2e-4 < loss < 4e-3  # 1.28 mJ a cycle at 90 V of the ideal stack
