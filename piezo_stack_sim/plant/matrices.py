# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The algebra of small matrices from which both kernels make their propagators."""

from piezo_stack_sim.plant.compiled import jit

TERMS = 12  # of the series for one tick
SHORT = 0.25  # angle or decay of the fastest motion within a tick up to which that many do


@jit
def clear(array, size):
    """Set the first entries to zero."""
    for i in range(size):
        array[i] = 0.0


@jit
def product(a, b, factor, out):
    """Set ``out`` to the product of two square matrices and a factor."""
    size = a.shape[0]
    for i in range(size):
        clear(out[i], size)
        for j in range(size):
            weight = a[i, j] * factor
            if weight != 0.0:
                for c in range(size):
                    out[i, c] += weight * b[j, c]
