# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What was measured, made ready for comparison, and where it differs from the simulation."""
