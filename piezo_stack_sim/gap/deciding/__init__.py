# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From fits to an answer: which cause, how sure, and what to measure next."""
