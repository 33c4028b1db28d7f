# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The blind benchmark: devices with hidden effects, made by physics of their own, and the score.

Nothing in this folder imports the plant or the effects library. The generator integrates the
equations with a small fixed step instead of closed forms between events, and every hidden effect
has another functional form than the one that the diagnosis fits: otherwise a diagnosis would be
praised for recognising its own equations.

"""
