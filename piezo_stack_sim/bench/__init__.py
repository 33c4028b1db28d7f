# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Speed and accuracy of the plant beside those of other ways to compute the same device."""
