# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Signs of what the library lacks: they name a block, not a cause."""
