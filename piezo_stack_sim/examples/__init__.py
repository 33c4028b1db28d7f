# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Controllers to start from, each a ROS process of its own beside the device."""
