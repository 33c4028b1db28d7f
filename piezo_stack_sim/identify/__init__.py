# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of an actuator from recordings of it, or from its data sheet."""
