"""``python -m piezo_stack_sim`` is ``piezo_stack``."""

import sys

from piezo_stack_sim.cli import main

sys.exit(main())
