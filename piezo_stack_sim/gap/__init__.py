# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the simulation differs from recordings, which effect causes it, how far it shrinks."""


def __getattr__(name):
    """Import the diagnosis on first use: it loads the compiler."""
    if name == 'diagnose_set':
        from piezo_stack_sim.gap.diagnose import diagnose_set
        return diagnose_set
    if name == 'compare_set':
        from piezo_stack_sim.gap.compare import compare_set
        return compare_set
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
