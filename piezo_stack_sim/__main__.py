# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``python -m piezo_stack_sim`` is ``piezo_stack``."""

import sys

from piezo_stack_sim.cli import main

sys.exit(main())
