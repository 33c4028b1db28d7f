# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""A virtual piezoelectric stack actuator, and a diagnosis of what a real one does differently."""
