# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The virtual device as a ROS 2 node; the only folder, besides the examples, that knows ROS."""
