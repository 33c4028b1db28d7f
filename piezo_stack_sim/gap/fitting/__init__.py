# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hypotheses fitted to recordings: effects, pairs of them, and how wrong their form may be."""
