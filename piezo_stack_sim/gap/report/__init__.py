"""The report: one self-contained HTML file, rendered from the diagnosis alone."""

from piezo_stack_sim.gap.report.render import render_report, write_report

__all__ = ['render_report', 'write_report']
