# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``/diagnostics``: what a person on duty wants to know of a device, once a second."""

from __future__ import annotations

from dataclasses import dataclass, field

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue


@dataclass
class Findings:
    """The warnings of one second and the numbers behind them."""

    warnings: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    values: dict[str, object] = field(default_factory=dict)

    def warn_if(self, condition: object, text: str) -> None:
        """Add a warning if something is so."""
        if condition:
            self.warnings.append(text)

    def to_message(self, name: str, hardware_id: str, stamp: int) -> DiagnosticArray:
        """Return the message of one device; `stamp` in ns."""
        status = DiagnosticStatus(
            level=(DiagnosticStatus.ERROR if self.errors
                   else DiagnosticStatus.WARN if self.warnings else DiagnosticStatus.OK),
            name=name, hardware_id=hardware_id,
            message='; '.join(self.errors + self.warnings) or 'running',
            values=[KeyValue(key=key, value=_text(value)) for key, value in self.values.items()])
        message = DiagnosticArray(status=[status])
        message.header.stamp = Time(sec=stamp // 1_000_000_000, nanosec=stamp % 1_000_000_000)
        return message


def _text(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f'{value:.6g}' if isinstance(value, float) else str(value)
