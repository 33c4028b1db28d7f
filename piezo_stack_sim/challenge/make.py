# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Makes a batch of recording sets with hidden effects, and the labels that stay outside."""

from dataclasses import dataclass
import gzip
import hashlib
import io
import json
from pathlib import Path

import numpy as np

from piezo_stack_sim.atomic import atomic_path, write_text
from piezo_stack_sim.challenge import case, labels, programmes
from piezo_stack_sim.challenge.hidden import Context
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.spread import spread

DECIMALS = {'voltage': '%.7g', 'charge': '%.8g', 'displacement': '%.8g'}
#: A device that moves this many times the stroke which it has without effects has run away.
BROKEN = 5.0
#: Every so many rows of the noise-free truth are kept for the true shrinkage.
KEPT_ROWS = 10

PARAMETER_FILE = """\
# The nominal device of {name}, as its data sheet would have it.
/**:
  ros__parameters:
    actuator:
      model: {model}
      mass: {m!r}
      stiffness: {k!r}
      damping: {b!r}
      linear_capacitance: {C!r}
      transformer_ratio: {T!r}
      maxwell_stiffness: {K}
      maxwell_break_voltage: {V}
      voltage_range: [0.0, 150.0]
      relative_uncertainty: {uncertainty!r}
    rate: 1000.0
    drive: voltage
"""


def set_name(index):
    """Return the folder name of set number `index`."""
    return f'set_{index:03d}'


def make(sets, seed, out, jobs=None, scheduler=None, progress=None, unforeseen=False,
         patchy=False):
    """
    Make a batch: the public folder `out` and, beside it, its labels.

    Parameters
    ----------
    sets, seed : int
        Same numbers, same batch, to the byte. Finished sets are kept when run again.
    out : str or Path
        Public folder. Labels go to ``<out>.labels.json``, noise-free responses to
        ``<out>.truth/``.
    jobs, scheduler : int and str, optional
        As `spread` takes them.
    progress : callable, optional
        Called with the number of finished sets.
    unforeseen : bool, optional
        Whether all sets hide what no rule of the diagnosis was made for.
    patchy : bool, optional
        Whether readings are missing: the devices are the same, their recordings have holes.

    Returns
    -------
    Path
        The label file.

    Raises
    ------
    InputError
        When the folder holds another batch.

    """
    out = Path(out)
    if sets < 1:
        raise InputError(f'--sets {sets}: expected at least 1')
    ours = batch_id(sets, seed, unforeseen, patchy)
    truth = labels.truth_folder(out)
    owner = truth / 'batch.txt'
    if owner.is_file() and owner.read_text().strip() != ours:
        raise InputError(f'{out}: holds another batch (sets, seed or kind differ); '
                         'give another --out')
    write_text(owner, ours + '\n')
    schedule = case.schedule(sets, seed, unforeseen)
    waiting = [i for i in range(sets) if not (
        (truth / f'{set_name(i)}.json').is_file()
        and (out / 'devices' / f'{set_name(i)}.yaml').is_file())]
    finished = sets - len(waiting)
    if progress:
        progress(finished)
    tasks = [(out.resolve(), i, seed, *schedule[i], patchy) for i in waiting]
    for _, result in spread(make_set, tasks, jobs, scheduler):
        if isinstance(result, Exception):
            raise result
        finished += 1
        if progress:
            progress(finished)
    write_text(out / 'challenge.json', json.dumps({
        'schema': 'piezo_stack_sim/challenge/1',
        'sets': [set_name(i) for i in range(sets)],
        'device': 'devices/<set>.yaml',
    }, indent=1) + '\n')
    return labels.commit(out, {
        'seed': seed,
        'sets': {set_name(i): json.loads((truth / f'{set_name(i)}.json').read_text())
                 for i in range(sets)},
    })


def batch_id(sets, seed, unforeseen=False, patchy=False):
    """Return a fingerprint of a batch, of which the seed cannot be read off."""
    kind = (' unforeseen' if unforeseen else '') + (' patchy' if patchy else '')
    return hashlib.sha256(f'challenge/1 {sets} {seed}{kind}'.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Drawn:
    """
    What was drawn for a set: its setting, what is hidden, and the responses by recording.

    ``true`` of the device, ``clean`` without what is hidden, ``alone`` with each of it, ``file``
    of the device of the parameter file; ``seen`` and ``beside`` how far what is hidden stands
    out, by itself and beside the other.  ``shows`` tells whether it does.
    """

    setting: object
    recordings: list
    hidden: list
    true: list
    clean: list
    alone: dict
    file: list
    seen: dict
    beside: dict
    attempts: int
    shows: bool


def draw_visible(random, kind, ids):
    """Draw a setting, and magnitudes of what is hidden in it until that shows, or for so long."""
    setting = case.draw_setting(random, ids)
    recordings = programmes.programmes(setting.plan)
    clean = case.responses(setting.clean, recordings)
    moved, file = case.sensitivities(setting, recordings)
    top = max(float(programme.command.max()) for programme in recordings)
    context = Context(top=top, stroke=max(float(r['displacement'].max()) for r in clean))
    drawn = None
    for attempt in range(case.TRIES):
        hidden = [(key, case.EFFECTS[key].draw(random, context)) for key in ids]
        true = case.responses(case.hide(setting.clean, hidden), recordings) if ids else clean
        if not all(np.ptp(r['displacement']) < BROKEN * context.stroke for r in true):
            continue  # a bow that softens can do that; what is not a number is not less either
        alone = {key: true if len(ids) == 1 else case.responses(
            case.hide(setting.clean, [(key, values)]), recordings) for key, values in hidden}

        def visible(some, against):
            return case.visibility(setting, case.difference(setting, some, against), moved)

        seen = {key: visible(alone[key], clean) for key in ids}
        named = seen | {key: visible(alone[key], case.responses(case.hide(
            setting.clean, [(key, values | case.EFFECTS[key].without)]), recordings))
            for key, values in hidden if case.EFFECTS[key].without}
        # A driver at its rail keeps the stack from whatever stands further out.
        beside = {key: visible(true, alone[other])
                  for key, other in zip(ids, reversed(ids)) if key != other}
        shows = all(max(levels.values()) >= case.VISIBLE[kind]
                    for levels in (*named.values(), *beside.values()))
        drawn = Drawn(setting, recordings, hidden, true, clean, alone, file, seen, beside,
                      attempt + 1, shows)
        if shows:
            break
    if drawn is None:
        raise InputError(f'{" and ".join(ids)}: drawn {case.TRIES} times; each device ran away')
    return drawn


def make_set(out, index, seed, kind, ids, patchy=False):
    """Make one set and write it with its truth; `kind` and `ids` come from the schedule."""
    name = set_name(index)
    random = np.random.default_rng([seed, index])
    attempts = 0
    for _ in range(case.SETTINGS):
        drawn = draw_visible(random, kind, ids)
        attempts += drawn.attempts
        if drawn.shows:
            break
    setting, recordings, true = drawn.setting, drawn.recordings, drawn.true
    measured = [with_noise(setting, programme, channels, random)
                for programme, channels in zip(recordings, true)]
    if patchy:
        # By dice of its own: the device and its noise are those of the same seed without holes.
        measured = with_holes(measured, np.random.default_rng([seed, index, 0x401E5]))
    for programme, channels in zip(recordings, measured):
        write_recording(out / name / f'{programme.name}.csv.gz', programme, channels,
                        setting.force_column)
    write_text(out / 'devices' / f'{name}.yaml', parameter_file(name, setting.file))
    truth = labels.truth_folder(out)
    digest = write_truth(truth / f'{name}.npz', drawn)
    label = describe(drawn, kind)
    label['truth_sha256'] = digest
    label['attempts'] = attempts
    write_text(truth / f'{name}.json', json.dumps(label))


def with_noise(setting, programme, channels, random):
    """Return the measured channels: noise, zeroed sensors, converter."""
    out = {}
    for channel in setting.channels:
        noise = setting.noise[channel]
        values = channels[channel] + noise.samples(programme.time, random)
        if channel != 'voltage' and setting.tare == 'first':
            values = values - values[0]
        out[channel] = noise.quantise(values)
    return out


def with_holes(measured, random):
    """
    Return the channels of every recording with readings missing, NaN.

    In two of three sets a sensor, or all of them, gives every second to every eighth row only;
    in one of two, messages are lost here and there.

    """
    every = dict.fromkeys(measured[0], 1)
    for channel in every if random.random() < 0.33 else [str(random.choice(list(every)))]:
        every[channel] = int(random.choice([1, 2, 4, 5, 8], p=[4 / 12, 3 / 12, 2 / 12, 2 / 12,
                                                               1 / 12]))
    lost = random.uniform(0.005, 0.05) if random.random() < 0.5 else 0.0
    holes = []
    for channels in measured:
        held = {}
        for channel, values in channels.items():
            there = np.arange(values.size) % every[channel] == 0
            there &= random.random(values.size) >= lost
            held[channel] = np.where(there, values, np.nan)
        holes.append(held)
    return holes


def write_recording(path, programme, channels, force_column):
    """Write one gzipped CSV; the same content gives the same bytes."""
    columns = {'time': (programme.time, '%.6f'), 'voltage_command': (programme.command, '%.10g')}
    if force_column:
        columns['external_force'] = (programme.force, '%.10g')
    columns.update({name: (values, DECIMALS[name]) for name, values in channels.items()})
    text = io.BytesIO()
    np.savetxt(text, np.stack([values for values, _ in columns.values()], axis=1),
               fmt=','.join(form for _, form in columns.values()),
               header=','.join(columns), comments='')
    with atomic_path(path) as partial:
        partial.write_bytes(gzip.compress(text.getvalue(), 6, mtime=0))


def parameter_file(name, stack):
    """Return the text of the parameter file of a set's nominal device."""
    values = {key: float(getattr(stack, key)) for key in case.NOMINALS}
    return PARAMETER_FILE.format(
        name=name, model='NEC/TOKIN AE0505D16', uncertainty=case.UNCERTAINTY,
        K=[round(float(k), 2) for k in stack.K], V=[round(float(v), 8) for v in stack.V], **values)


def write_truth(path, drawn):
    """Keep thinned noise-free responses of the device and of the file's device; return a hash."""
    arrays = {}
    for programme, now, ideal, nominal in zip(drawn.recordings, drawn.true, drawn.clean,
                                              drawn.file):
        for channel in drawn.setting.channels:
            for kind, source in (('true', now), ('clean', ideal), ('file', nominal)):
                values = source[channel][::KEPT_ROWS]
                arrays[f'{kind}/{programme.name}/{channel}'] = values.astype(np.float32)
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    with atomic_path(path) as partial:
        partial.write_bytes(stream.getvalue())
    digest = hashlib.sha256()
    for key in sorted(arrays):
        digest.update(key.encode() + arrays[key].tobytes())
    return digest.hexdigest()


def describe(drawn, kind):
    """Return the label of a set: what was hidden, how large it is, what the unit is."""
    setting, recordings = drawn.setting, drawn.recordings
    true, clean, file = drawn.true, drawn.clean, drawn.file
    alone, seen, beside = drawn.alone, drawn.seen, drawn.beside
    names = [programme.name for programme in recordings]

    def power(some, others):
        return {channel: {name: float(np.mean((a[channel] - b[channel]) ** 2))
                          for name, a, b in zip(names, some, others)}
                for channel in setting.channels}

    effects = []
    for key, parameters in drawn.hidden:
        effect = case.EFFECTS[key]
        over = case.difference(setting, alone[key], clean)

        def loudest(levels):
            return {channel: max(level for (_, c), level in levels.items() if c == channel)
                    for channel in setting.channels}

        effects.append({
            'id': key, 'block': effect.block, 'form': effect.form, 'parameters': parameters,
            'in_library': key in case.KNOWN, 'lookalikes': list(effect.lookalikes),
            'over_noise': {channel: max(float(np.sqrt(np.mean(e ** 2)))
                                        for _, c, e in over if c == channel)
                           for channel in setting.channels},
            'over_noise_calibrated': loudest(seen[key]),
            # What it adds to the other effect of a pair.
            **({'over_noise_beside': loudest(beside[key])} if key in beside else {}),
            # Mean squares (SI): left over when exactly this one effect is modelled.
            'left_if_alone': power(true, alone[key]),
        })
    stack, nominal = setting.clean.stack, setting.file
    return {
        'kind': kind,
        'effects': effects,
        'channels': list(setting.channels),
        'recordings': names,
        'noise': {channel: {'rms': setting.noise[channel].rms,
                            'colour': setting.noise[channel].colour,
                            'resolution': setting.noise[channel].resolution}
                  for channel in setting.channels},
        'tare': setting.tare,
        'scatter': {key: getattr(stack, key) / getattr(nominal, key) - 1.0
                    for key in case.NOMINALS},
        'curve': {'of_the_file': not np.array_equal(nominal.K, case.Stack().K),
                  'scattered': not np.array_equal(nominal.K, stack.K)},
        # Mean squares (SI) without noise: against the same unit without effects, and against
        # the device of the parameter file.
        'gap': power(true, clean),
        'gap_to_file': power(true, file),
    }
