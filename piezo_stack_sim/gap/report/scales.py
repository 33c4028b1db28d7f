# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Places on a horizontal scale, in per cent of its width."""

from dataclasses import dataclass
import math


@dataclass(frozen=True)
class Scale:
    """
    A scale from ``low`` to ``high``, linear or logarithmic.

    Attributes
    ----------
    low, high : float
        The values at 0 and 100 per cent.
    logarithmic : bool
        Whether equal ratios take equal widths; both ends are positive then.

    """

    low: float
    high: float
    logarithmic: bool = False

    @classmethod
    def between(cls, low, high):
        """Return a scale over two bounds, logarithmic over decades; None without both bounds."""
        if low is None or high is None or not low < high:
            return None
        return cls(low, high, logarithmic=low > 0 and high / low > 50)

    def place(self, value):
        """Return the place of a value from 0 to 100, at the edge if it lies beyond; None stays."""
        if value is None:
            return None
        low, high = self.low, self.high
        if self.logarithmic:
            value = max(value, low)
            low, high, value = map(math.log, (low, high, value))
        if not low < high:
            return 0.0
        return round(100.0 * min(max((value - low) / (high - low), 0.0), 1.0), 2)
