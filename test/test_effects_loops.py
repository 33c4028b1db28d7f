# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which effect that comes late opens which loop."""

import math

from effect_probes import device, IDEAL, lags, mixed
from piezo_stack_sim.plant import simulate
import pytest

FAMILY = {
    'command_delay': 'u-v', 'amplifier_bandwidth': 'u-v', 'amplifier_current_limit': 'u-v',
    'rate_dependent_hysteresis': 'v-q', 'sensor_lag': 'q-x', 'sensor_delay': 'q-x'}

PAIRS = ('u-v', 'v-q', 'q-x')

FREQUENCIES = (10.0, 100.0, 1000.0)


@pytest.fixture(scope='module')
def table():
    """Return lag (degrees) and gain added to each pair of signals, by effect and frequency."""
    ideal = {f: lags(IDEAL, f) for f in FREQUENCIES}
    rows = {}
    for name in FAMILY:
        for f in FREQUENCIES:
            pairs = zip(lags(device(name), f), ideal[f])
            rows[name, f] = [(lag - lag0, gain / gain0 - 1.0)
                             for (gain, lag), (gain0, lag0) in pairs]
    print(f'\n{"lag (degrees) and gain (%) added":36s}' + ''.join(f'{p:>18s}' for p in PAIRS))
    for (name, f), row in rows.items():
        print(f'{name:28s}{f:5.0f} Hz' + ''.join(f'{a:9.2f}{100 * g:9.2f}' for a, g in row))
    return rows


@pytest.mark.parametrize('name', FAMILY)
def test_each_of_the_lag_family_opens_its_own_loop(name, table):
    own = PAIRS.index(FAMILY[name])
    opened = [abs(lag) for lag, _ in table[name, 1000.0]]
    assert opened[own] > 2.0
    for pair, lag in enumerate(opened):
        if pair != own:
            assert lag < 0.35 * opened[own], PAIRS[pair]


@pytest.mark.parametrize('name, growth, gain', [
    ('command_delay', (9.9, 10.1), (-1e-3, 1e-3)),  # lag in proportion, gain flat
    ('sensor_delay', (9.9, 10.1), (-1e-3, 1e-3)),
    ('sensor_lag', (6.0, 9.9), (-0.4, -0.2)),  # lag saturates, gain falls
    ('amplifier_bandwidth', (8.0, 20.0), (-0.1, -0.01)),
    ('amplifier_current_limit', (50.0, math.inf), (-0.2, -0.01)),  # nothing, then a lot
    ('rate_dependent_hysteresis', (3.0, 30.0), (-0.1, -0.01)),
])
def test_how_a_lag_grows_from_100_to_1000_hertz(name, growth, gain, table):
    pair = PAIRS.index(FAMILY[name])
    slow, fast = table[name, 100.0][pair], table[name, 1000.0][pair]
    assert growth[0] < fast[0] / max(slow[0], 1e-3) < growth[1]
    assert gain[0] < fast[1] < gain[1]


def test_a_current_limit_depends_on_amplitude_and_a_resistance_does_not():
    added = {}
    for name, given in (('amplifier_current_limit', {'output_resistance': 1.0}),
                        ('amplifier_bandwidth', {})):
        for high in (25.0, 60.0):
            lag = lags(device(name, **given), 1000.0, high=high)[0][1]
            added[name, high] = lag - lags(IDEAL, 1000.0, high=high)[0][1]
    assert added['amplifier_current_limit', 25.0] < 0.1
    assert added['amplifier_current_limit', 60.0] > 2.0
    assert added['amplifier_bandwidth', 25.0] == pytest.approx(
        added['amplifier_bandwidth', 60.0], rel=0.3)


def test_the_mixed_probe_stays_in_the_range_of_the_table():
    time, voltage, force = mixed()
    assert not simulate(IDEAL, time, voltage, force).charge_out_of_range
