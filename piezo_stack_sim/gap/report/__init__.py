# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The report: one self-contained HTML file, rendered from the diagnosis alone."""

from piezo_stack_sim.gap.report.render import render_report, write_report

__all__ = ['render_report', 'write_report']
