"""The report of a study of trials."""

from cogless.report.trials.lines import phase_lines
from cogless.report.trials.page import render, write
from cogless.report.trials.plots import write_plots

__all__ = ["phase_lines", "render", "write", "write_plots"]
