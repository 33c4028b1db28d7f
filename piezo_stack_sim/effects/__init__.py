# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The effects that a real set-up adds to the ideal stack, one file each."""
