# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The stack as a user meets it: simulate a recording, or step a device in time.

:class:`Plant` is the streaming form, :func:`simulate` the offline one.  Both
run the same segments through the same kernel, so the same commands give the
same numbers to the bit, however they are cut into calls.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import layout, ports
from piezo_stack_sim.plant.assembly import assemble, System
from piezo_stack_sim.plant.build import build_model
from piezo_stack_sim.plant.parameters import Device
from piezo_stack_sim.plant.rest import Lead, rest
from piezo_stack_sim.plant.samples import PlantState, Response, Sample
from piezo_stack_sim.plant.sensors import disturb, disturbs
from piezo_stack_sim.plant.shown import Course, Shown
from piezo_stack_sim.plant.tables import Tables, TICK

SETTLING = 5e-3  # s, after which a device that was led somewhere rests: a hundred times m/b
MOST_ROWS = 500  # but not more rows than these
# Where the sensors read zero: displacement (m) and charge (C), the charge from which that in
# the stack counts (C), and what the sensors make of that (m).
N_ZEROS, Z_INSIDE, Z_SHOWN = 4, 2, 3


class Plant:
    """
    A device that is stepped in time.

    Parameters
    ----------
    device : Device
        Actuator, load, effects and sensor noise.
    period : float, optional
        Sample period (s); ``1 / device.rate`` if not given.
    drive : str, optional
        ``voltage``, ``charge``, ``open`` or ``shorted``; the device's own if
        not given.
    noise : bool
        Whether the sensors are noisy and quantised as the device says.
    start : tuple of float
        Voltage command (V) and external force (N) under which the device rests when it
        starts, led there slowly; its sensors are zeroed there.  The command counts for the
        drive ``voltage``; under the others the leads have been shorted, or open.
    before : sequence of float
        Voltages (V) that it had been led to before that, one after the other.

    """

    def __init__(self, device: Device, period: float | None = None,
                 drive: str | None = None, noise: bool = True,
                 start: tuple[float, float] = (0.0, 0.0), before: Sequence[float] = ()) -> None:
        self.device = device
        self.start, self.before = start, tuple(before)
        self.period = 1.0 / device.rate if period is None else float(period)
        if not self.period > 0.0 or not math.isfinite(self.period):
            raise InputError(f'sample period {self.period} s: expected a positive number')
        self.noisy = noise
        self._configure(drive or device.drive)
        self.reset()

    # -- set-up ----------------------------------------------------------------

    def _configure(self, drive: str) -> None:
        model = build_model(self.device, drive)
        self.drive = drive
        self._model = model
        self._sensors_disturb = disturbs(self.device.noise)
        self._system = assemble(model)
        h = self.period
        self._command_lag, command_phase = _split_delay(model.command_delay, h)
        self._reading_lag, reading_phase = _split_delay(model.sensor_delay, h)
        self._reading_phase = reading_phase
        lags = tuple(model.reading_lags.values())
        self._shown = Shown([
            *(Course(self._by_charge(f), model.settling, lags) for f in model.charge_maps),
            *(Course(_by_force(f), 0.0, lags) for f in model.joint_maps)])
        cuts = {command_phase, h - reading_phase, h} - {0.0}
        ends = sorted(cuts)
        starts = [0.0, *ends[:-1]]
        self._parts = len(ends)
        # Which command rules a part: the newest one, or the one before it.
        self._part_command = np.array(
            [0 if start >= command_phase else -1 for start in starts]) - self._command_lag
        self._part_reads = np.array([end == h - reading_phase for end in ends])
        durations = [end - start for start, end in zip(starts, ends)]
        self._tables = Tables(self._system, durations)
        # Nothing but the kernel stands between a command and its sample: `_step` will do.
        self._is_plain = not (self._parts > 1 or self._command_lag or self._reading_lag
                              or model.command_maps or model.reading_maps or self._shown
                              or (self.noisy and self._sensors_disturb))
        self._first = np.zeros(1, dtype=np.int64)
        self._source, self._force, self._reading = np.empty(1), np.empty(1), np.empty(1)
        self._outputs = np.empty((1, layout.N_OUTPUTS))

    def reset(self) -> None:
        """
        Return to the start, time zero.

        Relaxed (or as ``initial_polarisation`` says), or led on from there to `start`.
        """
        system, model = self._system, self._model
        voltage, force = self.start
        source = 0.0
        if (voltage or force) and self.drive == 'voltage':
            source = float(self.source_values(np.array([voltage]))[0])
        led = bool(source or force)
        self.time = 0.0
        self._ticks = 0
        self._s = system.initial.copy()
        # Elements that break later one way than the other are ones that start off their middle.
        self._p = model.branch_difference * np.where(np.isfinite(system.r), system.r, 0.0)
        self._middle = float(self._p[-1])
        self._flags = np.zeros(layout.N_FLAGS, dtype=np.int64)
        self._inputs = np.zeros(layout.N_INPUTS)
        self._inputs[layout.ONE] = 1.0
        self._memory = np.zeros(layout.N_MEMORY)
        self._out_of_range = False
        self._zero = np.zeros(N_ZEROS)
        past = (*model.previous_voltages, *self.before)
        if led or any(past) or any(model.strains):
            self._polarise((*past, source), force)
        self._commands = np.full(self._command_lag + 1, source or self._idle_command())
        self._readings = np.zeros(self._reading_lag)
        self._bring_in_line(self._commands[0])
        if led:
            self._settle(self._commands[0])
        outputs, reading = self._raw()
        # What the charge does to the material counts from the relaxed one.
        joint = sum(function(outputs[6]) for function in model.joint_maps)
        self._zero = np.array([reading + joint, outputs[2], 0.0 if led else outputs[2], 0.0])
        self._shown.rest(outputs)
        reading += self._shown.now(outputs)
        self._readings[:] = reading
        if led and (self._model.reading_maps or self._shown):
            self._zero[Z_SHOWN] = self._measure(
                np.zeros(1), outputs[None, :], np.array([reading]), False)[0][0]
        seed = self.device.noise.seed
        self._random = np.random.Generator(np.random.PCG64(seed))

    def _polarise(self, voltages: tuple[float, ...], force: float = 0.0) -> None:
        """
        Lead the relaxed device quasi-statically to voltages in turn, and let it rest there.

        A force acts from the beginning: with the leads shorted, or open where the charge is held.
        """
        system = self._system
        lead = Lead(system, self._flags, self._p, force)
        if self.drive in ('voltage', 'shorted') or not force:
            if any(self._model.strains):
                lead.set_out(self._model.strains)
                voltages = voltages[len(self._model.previous_voltages):]
            for voltage in (0.0, *voltages) if force else voltages:
                lead.to(voltage)
        q = lead.charge
        ports.stick(self._flags, self._p, system.r, q)
        self._s += lead.states()
        self._inputs[layout.A_RC] = -system.k @ self._p  # all elements stick
        self._inputs[layout.FORCE] = force
        if voltages[-1]:
            self._inputs[layout.U] = voltages[-1]
            held = {'charge', 'velocity'} | (set() if lead.is_linear else {'displacement'})
            self._s = rest(system, self._s, q, voltages[-1], self._inputs,
                           set(system.state_names) - held)
        self._memory[:4] = (self._s[0], q, q, self._s[0])

    def _settle(self, source: float) -> None:
        """Hold a source value (V) until what is not linear rests, too; the time stands still."""
        rows = min(math.ceil(SETTLING / self._tables.ticks[0] / self._tables.tick[0]), MOST_ROWS)
        none = np.full(rows, -1)
        self._tables.run(
            np.zeros(rows, dtype=np.int64), np.full(rows, self._tables.ticks[0]),
            np.full(rows, source), np.full(rows, self._inputs[layout.FORCE]), none, none,
            [self._s, self._p, self._flags, self._inputs, self._memory],
            np.empty((0, layout.N_OUTPUTS)), np.empty(0))

    def _bring_in_line(self, source: float) -> None:
        """Settle the algebraic part (charge, offsets) for a source value, at no time."""
        self._inputs[layout.U] = math.nan  # differs from any value, so that the kernel settles
        one = np.zeros(1, dtype=np.int64)
        none = one - 1
        self._tables.run(
            one, one, np.array([source]), self._inputs[layout.FORCE:layout.FORCE + 1].copy(),
            none, none, [self._s, self._p, self._flags, self._inputs, self._memory],
            np.empty((0, layout.N_OUTPUTS)), np.empty(0))

    def _idle_command(self) -> float:
        """Return the source value that keeps the device as it is."""
        if self.drive not in ('charge', 'open'):
            return 0.0
        system = self._system
        return float(system.real[layout.R_SHARE] * (
            self._memory[layout.M_CHARGE] + system.opposing[1, :-1] @ self._s))

    # -- state -------------------------------------------------------------------

    @property
    def state(self) -> PlantState:
        """Return the whole memory of the device, independent of later steps."""
        return PlantState(
            self.time, self.drive, dict(zip(self._system.state_names, self._s.tolist())),
            self._p.tolist(), self._flags.tolist(), self._inputs.tolist(),
            self._memory.tolist(), self._commands.tolist(), self._readings.tolist(),
            self._zero.tolist(), self._out_of_range,
            _plain(self._random.bit_generator.state),
            self._shown.trail)

    def restore(self, state: PlantState) -> None:
        """
        Continue from a saved state.

        Raises
        ------
        InputError
            If the state belongs to a device with other elements or states, or
            is one that no history of commands can lead to.

        """
        if len(state.blocks) != self._system.k.size:
            raise InputError(f'saved plant state: {len(state.blocks)} Maxwell elements, expected '
                             f'{self._system.k.size}; use the state of the same actuator')
        sizes = {'flags': layout.N_FLAGS, 'inputs': layout.N_INPUTS, 'memory': layout.N_MEMORY,
                 'zero': N_ZEROS}
        for name, size in sizes.items():
            if len(getattr(state, name)) != size:
                raise InputError(f'saved plant state: {name} has {len(getattr(state, name))} '
                                 f'numbers, expected {size}; another version saved it')
        if state.drive != self.drive:
            self._configure(state.drive)
        wanted = set(self._system.state_names)
        if set(state.states) != wanted:
            missing = sorted(wanted.symmetric_difference(state.states))
            raise InputError(f'saved plant state: the states {missing} do not match the '
                             'effects of this device; use the same effects')
        if (len(state.commands), len(state.readings)) != (
                self._command_lag + 1, self._reading_lag):
            raise InputError('saved plant state: what is on its way through the delays does not '
                             'fit this device; use the same delays and sample period')
        if len(state.shown) != len(self._shown.trail):
            raise InputError('saved plant state: what the sensor is shown besides does not match '
                             'the effects of this device; use the same effects')
        blocks = np.array(state.blocks)
        apart = np.diff(self._system.r) * (1 + 1e-6) + 1e-12
        if not self._system.ints[layout.I_GROWING] and np.any(np.abs(np.diff(blocks)) > apart):
            raise InputError('saved plant state: blocks further apart than any history of '
                             'charge can leave them (break charges bound the differences)')
        self.time = float(state.time)
        self._ticks = round(self.time / self.period)
        self._s = np.array([state.states[name] for name in self._system.state_names])
        self._p = blocks
        self._flags = np.array(state.flags, dtype=np.int64)
        self._inputs = np.array(state.inputs)
        self._memory = np.array(state.memory)
        self._commands = np.array(state.commands)
        self._readings = np.array(state.readings)
        self._zero = np.array(state.zero)
        self._out_of_range = bool(state.out_of_range)
        self._shown.restore(state.shown)
        if state.noise is not None:
            self._random.bit_generator.state = state.noise

    def set_drive(self, drive: str) -> None:
        """Switch the drive without a jump in state; the present voltage or charge is held."""
        if drive == self.drive:
            return
        present = self.sample_exact()
        hold = present[3] if drive == 'voltage' else 0.0 if drive == 'shorted' else present[2]
        self._rebuild(drive, hold)
        self._commands[:] = hold

    def set_device(self, device: Device) -> None:
        """Change parameters while running; states keep their values (no jump in state)."""
        self.device = device
        self._rebuild(self.drive, self._inputs[layout.U])

    def _rebuild(self, drive: str, source: float) -> None:
        """Carry the state over to a new set-up; states that are new begin at rest."""
        old = dict(zip(self._system.state_names, self._s))
        old.setdefault('charge', self._memory[layout.M_CHARGE])
        voltage = self.sample_exact()[3]
        had_friction = self._system.ints[layout.I_FRICTION]
        commands, readings = self._commands, self._readings
        shown = readings[0] if readings.size else self._evaluate()[1]
        trail = self._shown.trail
        self._configure(drive)
        system = self._system
        self._s = np.array([old.get(name, start) for name, start in
                            zip(system.state_names, system.initial)])
        if not had_friction:
            self._memory[layout.M_FRICTION] = self._memory[layout.M_SLIDE] = self._s[0]
            self._flags[layout.F_FRIC] = 0
        self._inputs[layout.U] = source
        self._inputs[layout.A_FRICTION:] = 0.0
        self._s = rest(system, self._s, self._memory[layout.M_CHARGE], voltage, self._inputs,
                       set(system.state_names) - set(old))
        self._flags[layout.F_LIMIT] = 0
        self._bring_in_line(source)
        self._commands = _resized(commands, self._command_lag + 1)
        if len(trail) == len(self._shown.trail):
            self._shown.restore(trail)
        else:
            self._shown.rest(self._raw()[0])
        # A sensor that is later from now on shows what it shows until then.
        self._readings = _resized(readings, self._reading_lag, shown)

    @property
    def strains(self) -> np.ndarray:
        """Return the voltage of each element as a part of its break voltage, (n,) (Eq. 16)."""
        slipping = self._flags[layout.F_SLIP]
        strains = (self._memory[layout.M_CHARGE] - self._p) / self._system.r
        strains[:slipping] = self._flags[layout.F_DIR]
        return strains

    @property
    def charge_out_of_range(self) -> bool:
        """Whether an element that should not slip (the last one) has slipped since reset."""
        return self._out_of_range

    # -- stepping ------------------------------------------------------------------

    def _evaluate(self) -> tuple[np.ndarray, float]:
        """Return outputs and reading of the present state without advancing."""
        out, read = self._raw()
        return out, read + self._shown.now(out) if self._shown else read

    def _raw(self) -> tuple[np.ndarray, float]:
        """Return outputs and the linear part of the reading (m) of the present state."""
        tables = self._tables
        out, read = np.zeros((1, layout.N_OUTPUTS)), np.zeros(1)
        one = np.zeros(1, dtype=np.int64)
        state = [array.copy() for array in (self._s, self._p, self._flags, self._inputs,
                                            self._memory)]
        tables.run(one, one, self._inputs[layout.U:layout.U + 1].copy(),
                   self._inputs[layout.FORCE:layout.FORCE + 1].copy(), one, one, state, out, read)
        return out[0], float(read[0])

    def sample_exact(self) -> np.ndarray:
        """Return displacement, velocity, charge, voltage and force now, as they truly are."""
        return self._evaluate()[0][:5]

    def sample_noisy(self) -> dict[str, float]:
        """Return the reading of the present instant, with noise if the plant is noisy."""
        out, reading = self._evaluate()
        measured = self._measure(np.array([self.time]), out[None, :], np.array([reading]),
                                 self.noisy)
        names = ('displacement', 'velocity', 'charge', 'voltage', 'force')
        return {name: float(column[0]) for name, column in zip(names, measured)}

    def sample(self) -> Sample:
        """Return what the sensors show now, without advancing and without noise."""
        out, reading = self._evaluate()
        shown = self._readings[0] if self._readings.size else reading
        measured = self._measure(np.array([self.time]), out[None, :], np.array([shown]), False)
        return Sample(*(float(column[0]) for column in measured))

    def advance(self, command: float, external_force: float = 0.0) -> Sample:
        """
        Hold a command (V or C) and a force (N) for one period.

        Returns
        -------
        Sample
            What the sensors show at the end of the period.

        """
        if self._is_plain:
            if self.drive == 'voltage':
                return self._step(command, external_force)
            if self.drive == 'charge':
                return self._step(command + self._zero[1], external_force)
        measured = self._run(np.array([command], dtype=float),
                             np.array([external_force], dtype=float))
        return Sample(*(float(column[0]) for column in measured))

    def hold(self, external_force: float = 0.0) -> Sample:
        """
        Leave the terminals as they are for one period: no command yet, or a switched drive.

        Returns
        -------
        Sample
            What the sensors show at the end of the period.

        """
        if self._is_plain:
            return self._step(self._commands[0], external_force)
        measured = self._run(np.zeros(1), np.array([external_force], dtype=float),
                             self._commands[-1:])
        return Sample(*(float(column[0]) for column in measured))

    def run(self, commands, external_forces=None) -> Response:
        """
        Hold each command for one period.

        Parameters
        ----------
        commands : array_like, shape (n,)
            Voltages (V) or charges (C); ignored when the leads are open or shorted.
        external_forces : array_like, shape (n,), optional
            Forces (N) in the direction of extension.

        Returns
        -------
        Response
            n rows, each sampled at the end of its command's period.

        """
        commands = np.ascontiguousarray(commands, dtype=float)
        forces = (np.zeros_like(commands) if external_forces is None
                  else np.ascontiguousarray(external_forces, dtype=float))
        start = self._ticks
        measured = self._run(commands, forces)
        time = (start + 1 + np.arange(commands.size)) * self.period
        return self._response(time, measured)

    def record(self, commands: np.ndarray, forces: np.ndarray) -> Response:
        """Do what `run` does, with one row more before: what the sensors show now."""
        start = self._ticks
        measured = self._run(commands, forces, lead=True)
        return self._response((start + np.arange(commands.size + 1)) * self.period, measured)

    def _response(self, time: np.ndarray, measured: tuple[np.ndarray, ...]) -> Response:
        displacement, velocity, charge, voltage, force = measured
        return Response(time, displacement, velocity, charge, voltage, force,
                        self._out_of_range, self.state)

    def source_values(self, commands: np.ndarray) -> np.ndarray:
        """Return what the drive makes of commands: voltages (V) or charges (C)."""
        if self.drive == 'shorted':
            return np.zeros(commands.size)
        if self.drive == 'open':
            return np.full(commands.size, self._commands[-1])
        for function in self._model.command_maps:
            commands = function(commands)
        return commands + self._zero[1] if self.drive == 'charge' else commands

    @property
    def held_source(self) -> float:
        """Return the source value (V or C) that rules until the first command arrives."""
        return float(self._commands[0])

    @property
    def delays(self) -> tuple[float, float]:
        """Command delay and sensor delay (s)."""
        return self._model.command_delay, self._model.sensor_delay

    @property
    def system(self) -> System:
        """Return the device as the kernel takes it."""
        return self._system

    @property
    def zero(self) -> np.ndarray:
        """Displacement (m) and charge (C) at which the sensors read zero."""
        return self._zero[:2]

    def run_segments(self, tables: Tables, seg_class, seg_ticks, u, force, rows, reads,
                     out, read) -> None:
        """Run segments laid out by the caller; the state follows."""
        state = [self._s, self._p, self._flags, self._inputs, self._memory]
        tables.run(seg_class, seg_ticks, np.ascontiguousarray(u), np.ascontiguousarray(force),
                   rows, reads, state, out, read)

    def finish(self, time, out, read) -> Response:
        """Pass raw outputs of a timeline that began at ``time[0]`` through the sensors."""
        if self._shown:
            read = read + self._shown.follow_irregular(out, time, self._model.sensor_delay)
        measured = self._measure(self.time + (time[1:] - time[0]), out, read, self.noisy)
        self.time += time[-1] - time[0]
        self._ticks = round(self.time / self.period)
        self._note_range()
        return self._response(time[1:], measured)

    def _run(self, commands: np.ndarray, forces: np.ndarray, source: np.ndarray | None = None,
             lead: bool = False) -> tuple[np.ndarray, ...]:
        n = commands.size
        if source is None:
            source = self.source_values(commands)
        if not (np.isfinite(source).all() and np.isfinite(forces).all()):
            raise InputError('a command or force is not a finite number; nothing was advanced')
        history = np.concatenate([self._commands, source])
        parts = self._parts
        lag = self._command_lag + 1
        ticks = self._tables.ticks
        first = int(lead)
        numbers = np.arange(first, first + n)
        if parts == 1:
            seg_class, seg_ticks = np.zeros(n, np.int64), np.full(n, ticks[0])
            u = history[lag + self._part_command[0]:][:n]
            force = forces
            rows = reads = numbers
        else:
            seg_class = np.tile(np.arange(parts), n)
            seg_ticks = np.tile(ticks, n)
            index = np.arange(n)[:, None] + lag + self._part_command[None, :]
            u = history[index].ravel()
            force = np.repeat(forces, parts)
            rows = np.full((n, parts), -1)
            rows[:, -1] = numbers
            reads = np.where(self._part_reads[None, :], numbers[:, None], -1)
            rows, reads = rows.ravel(), np.ascontiguousarray(reads.ravel())
        out, read = np.empty((first + n, layout.N_OUTPUTS)), np.empty(first + n)
        if lead:
            out[0], shown = self._evaluate()
        state = [self._s, self._p, self._flags, self._inputs, self._memory]
        self._tables.run(seg_class, seg_ticks, np.ascontiguousarray(u), force, rows, reads,
                         state, out, read)
        self._commands = history[-lag:].copy()
        if self._shown and n:
            read[first:] += self._shown.follow(out[first:], self.period, self._reading_phase)
        if self._readings.size:
            late = np.concatenate([self._readings, read[first:]])
            self._readings = late[n:].copy()
            read[first:] = late[:n]
        if lead:
            read[0] = shown
        time = (self._ticks + 1 - first + np.arange(first + n)) * self.period
        self._ticks += n
        self.time = self._ticks * self.period
        self._note_range()
        return self._measure(time, out, read, self.noisy)

    def _step(self, source: float, force: float) -> Sample:
        """Do what `_run` does, for one period of a plain device: a third of its time."""
        if not (math.isfinite(source) and math.isfinite(force)):
            raise InputError('a command or force is not a finite number; nothing was advanced')
        self._source[0], self._force[0] = source, force
        first, out = self._first, self._outputs
        self._tables.run(first, self._tables.ticks, self._source, self._force, first, first,
                         (self._s, self._p, self._flags, self._inputs, self._memory), out,
                         self._reading)
        self._commands[0] = source
        self._ticks += 1
        self.time = self._ticks * self.period
        self._note_range()
        _, velocity, charge, voltage, transduced, *_ = out[0].tolist()
        return Sample(float(self._reading[0] - self._zero[0]), velocity,
                      float(charge - self._zero[1]), voltage, transduced)

    def _note_range(self) -> None:
        if self._p[-1] != self._middle or self._flags[layout.F_SLIP] == self._p.size:
            self._out_of_range = True

    def _by_charge(self, function: Callable) -> Callable:
        """Return a displacement (m) by the charge on the stack as one by outputs (n, outputs)."""
        # What the charge does to the material is done by that on the stack, not by what leaks.
        return lambda out: function(out[:, 5] - self._zero[Z_INSIDE])

    def _measure(self, time, out, read, noisy) -> tuple[np.ndarray, ...]:
        """Sensor side: zero, memoryless maps, noise, quantisation."""
        displacement = read - self._zero[0]
        charge = out[:, 2] - self._zero[1]
        for function in self._model.reading_maps:
            displacement = function(displacement, time)
        if self._zero[Z_SHOWN]:
            displacement = displacement - self._zero[Z_SHOWN]
        voltage = out[:, 3]
        if noisy and self._sensors_disturb:
            draws = self._random.standard_normal((time.size, 3))
            displacement, charge, voltage = disturb(self.device.noise, displacement, charge,
                                                    voltage, draws)
        return displacement, out[:, 1], charge, voltage, out[:, 4]


def _by_force(function: Callable) -> Callable:
    """Return a displacement (m) by the force through the joint as one by outputs (n, outputs)."""
    return lambda out: function(out[:, 6])


def _split_delay(delay: float, period: float) -> tuple[int, float]:
    """Whole periods and the rest (s); a rest shorter than a tick counts as none."""
    whole = math.floor(delay / period + 1e-9)
    rest = delay - whole * period
    return whole, (rest if rest > TICK else 0.0)


def _resized(values: np.ndarray, size: int, fill: float | None = None) -> np.ndarray:
    if values.size >= size:
        return values[values.size - size:].copy()
    first = fill if fill is not None else values[0]
    return np.concatenate([np.full(size - values.size, first), values])


def _plain(value):
    """Turn the numbers of a random generator's state into plain Python ones."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return int(value) if isinstance(value, (int, np.integer)) else value
