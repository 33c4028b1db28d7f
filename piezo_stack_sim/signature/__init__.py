# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What an effect looks like: the same tests with and without it, drawn and described."""
