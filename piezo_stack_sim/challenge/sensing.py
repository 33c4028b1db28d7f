# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From what the stack does to what the instruments say, without noise."""

from dataclasses import dataclass

from numba import njit
import numpy as np

from piezo_stack_sim.challenge.structure import sway

#: Points of a trace closer than this (s) are those of small steps.
QUICK = 1e-5


@dataclass(frozen=True)
class Sensing:
    """
    What stands between the moving end and the file; SI units; neutral by default.

    `seed` fixes what is random in the instruments themselves: walks, bursts, dropouts.

    """

    seed: int = 0
    # Mechanics outside the stack: a joint that stiffens under load, and play.
    joint_stiffness: float = np.inf  # N/m
    joint_force: float = 60.0  # N at which it is twice as stiff
    play: float = 0.0  # m
    # The structure between the stack and the point that is read: see its module.
    mode_parts: tuple = ()
    mode_frequencies: tuple = ()  # Hz
    mode_damping: float = 0.03
    mode_way: float = 1.0  # m
    # Environment: warming up in two stages with a slow swing, vibration, knocks.
    warming: float = 0.0  # m
    warming_time: float = 8.0  # s
    warming_share: float = 0.3  # of the second, slower stage
    swing: float = 0.0  # m
    swing_period: float = 40.0  # s
    vibration: float = 0.0  # m
    vibration_frequency: float = 50.0  # Hz
    vibration_harmonic: float = 0.3
    vibration_free_running: bool = True  # another phase in every recording
    knocks: float = 0.0  # m
    knock_rate: float = 4.0  # 1/s
    run_up: float = 0.0  # m, of a machine nearby that speeds up in every recording
    run_up_from: float = 20.0  # Hz
    run_up_to: float = 150.0  # Hz
    # Displacement sensor
    head_lag: float = 0.0  # s, of its head and what demodulates that: one pole
    lag: float = 0.0  # s, by which its output filter is late at low frequencies
    lag_quality: float = 0.577  # of that filter's pair of poles: Bessel 0.577, Butterworth 0.707
    conversion_period: float = 0.0  # s, converter with its own clock
    conversion_latency: float = 0.0  # s
    clock_error: float = 0.0
    bend: float = 0.0  # m, amplitude of the linearity error
    bend_length: float = 1.5e-5  # m
    gain: float = 1.0
    gain_swing: float = 0.0
    drift: float = 0.0  # m/s
    drift_walk: float = 0.0  # m/sqrt(s)
    crosstalk: float = 0.0  # m/V
    telegraph: float = 0.0  # m
    telegraph_rate: float = 5.0  # 1/s
    dropouts: float = 0.0  # fraction of time
    dropout_length: float = 2e-3  # s
    clipping: float = np.inf  # m, where the reading ends, softly
    clipping_knee: float = 1e-7  # m
    reading_step: float = 0.0  # m
    # Charge measurement
    leak_resistance: float = np.inf  # Ohm at small voltage
    leak_voltage: float = 60.0  # V, of its exponential growth
    droop_time: float = np.inf  # s
    discharge: float = 0.0  # C that goes past the ceramic at a time
    discharge_above: float = np.inf  # V
    discharge_rate: float = 5.0  # 1/s


@njit(cache=True)
def low_pass(time, signal, lag):
    """Return a first-order lag of a signal that is straight between its samples, exactly."""
    out = np.empty_like(signal)
    y = signal[0]
    out[0] = y
    for i in range(1, signal.size):
        dt = time[i] - time[i - 1]
        ramp = (signal[i] - signal[i - 1]) / dt * lag
        y = signal[i] - ramp + (y - signal[i - 1] + ramp) * np.exp(-dt / lag)
        out[i] = y
    return out


@njit(cache=True)
def filtered(time, signal, lag, quality):
    """
    Return a second-order low pass of a signal that is straight between its samples, exactly.

    Of a quality above 1/2: a pair of complex poles, of which one is followed.

    """
    out = np.empty_like(signal)
    omega = 1.0 / (quality * lag)
    damping = 0.5 / quality
    pole = omega * (-damping + 1j * np.sqrt(1.0 - damping * damping))
    share = omega * omega / (2j * pole.imag)
    y = -share / pole * signal[0]
    out[0] = signal[0]
    for i in range(1, signal.size):
        dt = time[i] - time[i - 1]
        ramp = (signal[i] - signal[i - 1]) / dt / pole
        y = (-share / pole * (signal[i] + ramp)
             + (y + share / pole * (signal[i - 1] + ramp)) * np.exp(pole * dt))
        out[i] = 2.0 * y.real
    return out


@njit(cache=True)
def with_play(signal, width):
    """Return the play operator of a signal: it follows only at the edge of a gap."""
    out = np.empty_like(signal)
    y = signal[0]
    for i in range(signal.size):
        y = min(max(y, signal[i] - 0.5 * width), signal[i] + 0.5 * width)
        out[i] = y
    return out


def between(seen, t, x, speed):
    """
    Return a motion at other times than those of its trace: the cubic with its speeds there.

    In long holds, where only a mean speed is known, it goes straight.

    """
    seen = np.clip(seen, t[0], t[-1])
    i = np.clip(np.searchsorted(t, seen, side='right') - 1, 0, t.size - 2)
    h = t[i + 1] - t[i]
    part = (seen - t[i]) / h
    rise = x[i + 1] - x[i]
    bent = (1.0 - part) * (speed[i] * h - rise) - part * (speed[i + 1] * h - rise)
    return x[i] + part * (rise + np.where(h < QUICK, (1.0 - part) * bent, 0.0))


def measure(sensing, trace, time, index):
    """
    Return the noise-free channels of one recording, sensors not yet zeroed.

    Parameters
    ----------
    sensing : Sensing
        What the sensors do.
    trace : (6, r) array
        Time, voltage, charge, displacement, force, speed as the integrator returns them.
    time : (n,) array
        Row times in s.
    index : int
        Number of the recording within the set, for what is random.

    Returns
    -------
    dict of str to (n,) array
        voltage (V), charge (C), displacement (m).

    """
    t, v, q, end, force, speed = trace
    x = end
    rows = np.searchsorted(t, time + 1e-9, side='right') - 1
    random = np.random.default_rng([sensing.seed, index, 811])
    if np.isfinite(sensing.joint_stiffness):
        # Its stiffness grows with the load: deflection is a logarithm of the force.
        x = x + np.sign(force) * sensing.joint_force / sensing.joint_stiffness * np.log1p(
            np.abs(force) / sensing.joint_force)
    if sensing.play > 0.0:
        x = with_play(x, sensing.play)
    if sensing.mode_parts:
        x = x + sway(t, x, sensing.mode_frequencies, sensing.mode_damping, sensing.mode_way,
                     sensing.mode_parts)
    x = x + surroundings(sensing, t - t[0], random)
    if sensing.head_lag > 0.0:
        x = low_pass(t, x, sensing.head_lag)
    if sensing.lag > 0.0:
        x = filtered(t, x, sensing.lag, sensing.lag_quality)
    seen = time[0] + (time - time[0]) * (1.0 + sensing.clock_error) - sensing.conversion_latency
    if sensing.conversion_period > 0.0:
        # The converter finished its last reading at its own last tick.
        seen = np.floor(seen / sensing.conversion_period) * sensing.conversion_period
    same = np.array_equal(seen, time)
    displacement = x[rows] if same else between(seen, t, end, speed) + np.interp(seen, t, x - end)
    displacement = distort(sensing, displacement, v[rows], time - time[0], random)
    charge = q
    if np.isfinite(sensing.leak_resistance):
        current = sensing.leak_voltage / sensing.leak_resistance * np.sinh(
            v / sensing.leak_voltage)
        charge = charge + np.concatenate(
            [[0.0], np.cumsum(0.5 * (current[1:] + current[:-1]) * np.diff(t))])
    if sensing.discharge:
        struck = (random.random(t.size) < sensing.discharge_rate * np.diff(t, prepend=t[0])) & (
            v > sensing.discharge_above)
        charge = charge + sensing.discharge * np.cumsum(
            struck * random.uniform(0.3, 1.7, t.size))
    if np.isfinite(sensing.droop_time):
        # A charge amplifier forgets: high pass.
        charge = charge - low_pass(t, charge - charge[0], sensing.droop_time)
    return {'voltage': v[rows], 'charge': charge[rows], 'displacement': displacement}


def surroundings(sensing, t, random):
    """Return the displacement (r,) in m that comes from outside."""
    x = np.zeros_like(t)
    if sensing.warming or sensing.swing:
        quick = 1.0 - np.exp(-t / sensing.warming_time)
        slow = 1.0 - np.exp(-t / (5.0 * sensing.warming_time))
        share = sensing.warming_share
        x += sensing.warming * ((1.0 - share) * quick + share * slow)
        x += sensing.swing * np.sin(2.0 * np.pi * t / sensing.swing_period)
    if sensing.vibration:
        phases = random.uniform(0.0, 2.0 * np.pi, 2)
        if not sensing.vibration_free_running:
            phases = np.random.default_rng(sensing.seed).uniform(0.0, 2.0 * np.pi, 2)
        angle = 2.0 * np.pi * sensing.vibration_frequency * t
        x += sensing.vibration * (np.sin(angle + phases[0]) + sensing.vibration_harmonic
                                  * np.sin(2.0 * angle + phases[1]))
    if sensing.run_up:
        speeding = 0.5 * (sensing.run_up_to - sensing.run_up_from) * t ** 2 / t[-1]
        x += sensing.run_up * np.sin(2.0 * np.pi * (sensing.run_up_from * t + speeding)
                                     + random.uniform(0.0, 2.0 * np.pi))
    if sensing.knocks:
        count = max(2, random.poisson(sensing.knock_rate * t[-1]))
        for start in random.uniform(0.0, 0.95 * t[-1], count):
            size = sensing.knocks * random.uniform(0.5, 1.5)
            decay, frequency = random.uniform(5e-3, 2e-2), random.uniform(80.0, 400.0)
            after = t[np.searchsorted(t, start):] - start
            x[t.size - after.size:] += size * np.exp(-after / decay) * np.sin(
                2.0 * np.pi * frequency * after)
    return x


def distort(sensing, x, v, t, random):
    """Return displacement readings (n,) as the sensor and its converter distort them."""
    if sensing.bend:
        angle = np.pi * x / sensing.bend_length
        x = x + sensing.bend * (np.sin(angle) + 0.25 * np.sin(2.0 * angle))
    x = sensing.gain * x
    if sensing.gain_swing:
        x = x * (1.0 + sensing.gain_swing * np.sin(2.0 * np.pi * t / 60.0))
    if sensing.crosstalk:
        x = x + sensing.crosstalk * v
    if sensing.drift or sensing.drift_walk:
        steps = random.standard_normal(t.size) * np.sqrt(np.diff(t, prepend=t[0]))
        x = x + sensing.drift * t + sensing.drift_walk * np.cumsum(steps)
    if sensing.telegraph:
        flips = random.random(t.size) < sensing.telegraph_rate * np.diff(t, prepend=t[0])
        # Short recordings see a flip too, or the effect would not be there at all.
        flips[random.integers(t.size // 4, 3 * t.size // 4)] = True
        x = x + sensing.telegraph * (np.cumsum(flips) % 2)
    if sensing.dropouts:
        length = max(2, int(round(sensing.dropout_length / (t[1] - t[0]))))
        count = max(2, int(sensing.dropouts * t.size / length))
        for start in random.integers(1, t.size - length, count):
            x[start:start + length] = x[start - 1]
    if np.isfinite(sensing.clipping):
        x = sensing.clipping - sensing.clipping_knee * np.logaddexp(
            0.0, (sensing.clipping - x) / sensing.clipping_knee)
    if sensing.reading_step:
        x = sensing.reading_step * np.round(x / sensing.reading_step)
    return x
