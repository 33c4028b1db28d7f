# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Faults done to running nodes on purpose, and what must hold meanwhile and afterwards."""
