# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Noise of the instruments, its colour and level, and the steps of their converters."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Noise:
    """One channel's noise: SI units."""

    rms: float
    colour: str = 'white'  # white, red (first-order), pink (1/f on top of white)
    corner: float = 300.0  # Hz, of red noise
    resolution: float = 0.0  # quantisation step

    def samples(self, time, random):
        """Return noise (n,) of the given rms for row times (n,) in s."""
        n = time.size
        white = random.standard_normal(n)
        if self.colour == 'white':
            return self.rms * white
        if self.colour == 'red':
            keep = np.exp(-2.0 * np.pi * self.corner * (time[1] - time[0]))
            drive = np.sqrt(1.0 - keep ** 2)
            out = np.empty(n)
            level = white[0]
            for i in range(n):
                level = keep * level + drive * white[i]
                out[i] = level
            return self.rms * out
        spectrum = np.fft.rfft(random.standard_normal(n))
        frequency = np.fft.rfftfreq(n, time[1] - time[0])
        spectrum /= np.sqrt(np.maximum(frequency, frequency[1]))
        pink = np.fft.irfft(spectrum, n)
        pink *= 1.0 / pink.std()
        return self.rms * (0.8 * white + 0.6 * pink)

    def quantise(self, values):
        """Return values on the grid of the converter."""
        if self.resolution > 0.0:
            return self.resolution * np.round(values / self.resolution)
        return values


def draw(random):
    """Return random noise for every channel: a dict of Noise."""
    rms = {
        'voltage': np.exp(random.uniform(np.log(1e-3), np.log(2e-2))),
        'charge': np.exp(random.uniform(np.log(3e-9), np.log(4e-8))),
        'displacement': np.exp(random.uniform(np.log(0.4e-9), np.log(6e-9))),
    }
    colour = str(random.choice(['white', 'red', 'pink'], p=[0.6, 0.2, 0.2]))
    corner = float(random.uniform(200.0, 2000.0))
    steps = {'voltage': 200.0 / 2 ** 16, 'charge': 4e-4 / 2 ** 16, 'displacement': 3e-5 / 2 ** 16}
    coarse = random.random() < 0.6
    return {channel: Noise(float(level), colour if channel == 'displacement' else 'white', corner,
                           steps[channel] if coarse else 0.0)
            for channel, level in rms.items()}
