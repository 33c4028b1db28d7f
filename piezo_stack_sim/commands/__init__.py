# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The subcommands of ``piezo_stack``: one module each, imported when it is called."""
