# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""A device that was asked nothing agrees with any simulation: that is not to be called no gap."""

import numpy as np
from piezo_stack_sim.gap import diagnose_set
from piezo_stack_sim.gap.compare import compare_set
from piezo_stack_sim.gap.report.summary import summary_lines
from piezo_stack_sim.plant import Device
from piezo_stack_sim.recording.recording import Recording, RecordingSet
import pytest

TIME = 1e-3 * np.arange(3000)


def held(level):
    """Return a recording of noise, under a command that never moves (V)."""
    noise = 1e-9 * np.random.default_rng(2).standard_normal(TIME.size)
    return RecordingSet('held', (Recording(
        'held', TIME, 'voltage', np.full(TIME.size, level), measured={'displacement': noise},
        source='held.csv'),))


@pytest.mark.parametrize('level', [0.0, 50.0])
def test_inputs_that_stand_still_test_nothing(level):
    document = diagnose_set(held(level), Device.nominal()).document
    assert document['verdict'] == 'NOT_IDENTIFIABLE' and not document['selected']
    assert 'play a programme' in document['reason'] and document['where']['block'] is None
    said = '\n'.join(text for text, _ in summary_lines(document))
    assert 'ask the device nothing' in said and 'Where' not in said
    asked = document['next_experiment']
    assert asked['command'].split()[2] == asked['profile'] and asked['separation'] > 5.0
    assert not asked['add_channel'] and len(asked['alternatives']) == 2
    assert 'Play ' in said
    notes = [each['what'] for each in compare_set(held(level), Device.nominal())['preflight']]
    assert any('throughout' in note for note in notes)
