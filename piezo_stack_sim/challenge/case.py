# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""One device of a batch: what is drawn for it, and how large its hidden effects come out."""

from dataclasses import dataclass, replace

import numpy as np

from piezo_stack_sim.challenge import noise, programmes
from piezo_stack_sim.challenge.device import respond, Unit
from piezo_stack_sim.challenge.foreign import FOREIGN
from piezo_stack_sim.challenge.known import KNOWN
from piezo_stack_sim.challenge.stack import Stack
from piezo_stack_sim.challenge.unforeseen import UNFORESEEN

EFFECTS = {**KNOWN, **FOREIGN, **UNFORESEEN}
KINDS = {'none': 0.12, 'one': 0.60, 'two': 0.18, 'absent': 0.10}

#: What the parameter file says of its own numbers.
UNCERTAINTY = 0.02
#: An effect must reach this multiple of the noise in some recording, after the nominal parameters
#: have taken what they may, by itself and beside the other of a pair, or its magnitude is drawn
#: again.
VISIBLE = {'one': 0.5, 'two': 1.0, 'absent': 0.7}
TRIES = 12
#: And so many settings: a current limit is never met where every command is slow.
SETTINGS = 4
NOMINALS = ('m', 'k', 'b', 'C', 'T')
#: Of the Maxwell curve, stiffnesses and break voltages move at these many elements, and between
#: them in proportion: each element by itself would leave hardly less.
KNOTS = 5

CHANNELS = {
    ('voltage', 'charge', 'displacement'): 0.62,
    ('voltage', 'displacement'): 0.12,
    ('charge', 'displacement'): 0.10,
    ('displacement',): 0.16,
}


@dataclass(frozen=True)
class Setting:
    """All that is drawn for a set besides its hidden effects."""

    channels: tuple
    noise: dict
    plan: programmes.Plan
    file: Stack  # what the parameter file says
    clean: Unit  # what the unit is, effects apart
    tare: str  # 'first' or 'mean': how the sensors were zeroed
    force_column: bool


def schedule(sets, seed, unforeseen=False):
    """
    Return for each set its kind and the ids hidden in it: a list of (kind, tuple of id).

    Kinds come in their shares, rounded; single effects go round the whole list before one comes
    again.  Or all hide something that is ``unforeseen``.

    """
    random = np.random.default_rng([seed, 0x5C4ED])
    shares = {'absent': 1.0} if unforeseen else KINDS
    edges = np.round(sets * np.cumsum(list(shares.values()))).astype(int)
    kinds = random.permutation(np.repeat(list(shares), np.diff(edges, prepend=0)))
    decks = {'one': [], 'absent': []}
    sources = {'one': sorted(KNOWN), 'absent': sorted(UNFORESEEN if unforeseen else FOREIGN)}
    out = []
    for kind in kinds:
        ids: tuple[str, ...]
        if kind == 'none':
            ids = ()
        elif kind == 'two':
            ids = pair(random)
        else:
            if not decks[kind]:
                decks[kind] = list(random.permutation(sources[kind]))
            ids = (str(decks[kind].pop()),)
        out.append((str(kind), ids))
    return out


def pair(random):
    """Return two ids, four times out of five from different blocks."""
    while True:
        first, second = (str(name) for name in random.choice(sorted(KNOWN), 2, replace=False))
        if KNOWN[first].block != KNOWN[second].block or random.random() < 0.2:
            return first, second


def draw_setting(random, ids):
    """Return the Setting of one set."""
    recordings = [name for key in ids for name in EFFECTS[key].recordings]
    needs = [channel for key in ids for channel in EFFECTS[key].needs]
    kinds = list(CHANNELS)
    while True:
        channels = kinds[random.choice(len(kinds), p=list(CHANNELS.values()))]
        if all(channel in channels for channel in needs):
            break
    plan = programmes.draw(random, recordings)
    file = Stack()
    if random.random() < 0.25:
        # Another unit of the type: its curve is in the file. Break charges V/K keep their order.
        stiffer = np.exp(0.1 * random.standard_normal(file.K.size))
        later = np.exp(0.04 * random.standard_normal(file.K.size))
        file = file._replace(K=file.K * stiffer, V=file.V * stiffer * later)
    scatter = float(random.choice([0.0, 0.005, 0.01, 0.02], p=[0.15, 0.25, 0.4, 0.2]))
    unit = file._replace(**{name: getattr(file, name) * (1.0 + random.uniform(-scatter, scatter))
                            for name in NOMINALS})
    if random.random() < 0.15:
        unit = unit._replace(
            K=unit.K * (1.0 + 0.5 * UNCERTAINTY * random.uniform(-1.0, 1.0, unit.K.size)),
            V=unit.V * (1.0 + 0.5 * UNCERTAINTY * random.uniform(-1.0, 1.0, unit.V.size)))
    return Setting(channels, noise.draw(random), plan, file, Unit(stack=unit),
                   str(random.choice(['first', 'mean'])),
                   'force' in plan.names or bool(random.random() < 0.5))


def responses(unit, recordings):
    """Return the noise-free channels of every recording: a list of dict."""
    return [respond(unit, programme, index) for index, programme in enumerate(recordings)]


def difference(setting, some, others):
    """Return (recording, channel, error over noise rms) for the measured channels."""
    return [(i, channel, (one[channel] - other[channel]) / setting.noise[channel].rms)
            for i, (one, other) in enumerate(zip(some, others)) for channel in setting.channels]


def sensitivities(setting, recordings):
    """Return what 1 % more of each nominal parameter changes, and the file's own responses."""
    file = setting.file
    device = Unit(stack=file)
    base = responses(device, recordings)
    knots = np.arange(KNOTS)
    hats = [np.interp(np.linspace(0, KNOTS - 1, file.K.size), knots, knots == k) for k in knots]
    stacks = [file._replace(**{name: 1.01 * getattr(file, name)}) for name in NOMINALS]
    stacks += [file._replace(**{name: getattr(file, name) * (1.0 + 0.01 * hat)})
               for name in ('K', 'V') for hat in hats]
    moved = [difference(setting, responses(replace(device, stack=stack), recordings), base)
             for stack in stacks]
    return moved, base


def visibility(setting, errors, moved):
    """
    Return rms errors over noise that stay after calibration: dict of (recording, channel).

    The nominal parameters may move within their uncertainty, measured from where the unit is; the
    curve within half of it, as the curves of units scatter.

    """
    from scipy.optimize import lsq_linear
    thin = 7
    columns = [np.concatenate([row[2][::thin] for row in change]) for change in moved]
    target = np.concatenate([row[2][::thin] for row in errors])
    stack, file = setting.clean.stack, setting.file
    there = np.zeros(len(moved))
    there[:len(NOMINALS)] = [getattr(stack, name) / getattr(file, name) - 1.0
                             for name in NOMINALS]
    room = np.full(len(moved), 50.0 * UNCERTAINTY)
    room[:len(NOMINALS)] = 100.0 * UNCERTAINTY
    fit = lsq_linear(np.stack(columns, axis=1), target,
                     (-room - 100.0 * there - 1e-6, room - 100.0 * there + 1e-6))
    out = {}
    for row, error in enumerate(errors):
        left = error[2] - sum(share * change[row][2] for share, change in zip(fit.x, moved))
        out[error[:2]] = float(np.sqrt(np.mean(left ** 2)))
    return out


def hide(unit, hidden):
    """Return the device with effects given as a list of (id, parameters)."""
    for key, parameters in hidden:
        unit = EFFECTS[key].apply(unit, **parameters)
    return unit
