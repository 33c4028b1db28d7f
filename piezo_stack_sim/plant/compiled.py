# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How the plant's kernels are compiled.

They get every array from their caller and make none, so that numba need not count
references: counting them took two fifths of the time of a sub-step.
"""

from numba import njit

_HOW = {'cache': True, 'nogil': True, 'error_model': 'numpy', '_nrt': False}

jit = njit(**_HOW)
# Where passing a dozen arrays would cost more than the work.
inline = njit(forceinline=True, **_HOW)
# Sums in any order: they may run over several lanes.
dot = njit(fastmath={'reassoc', 'contract'}, **_HOW)
