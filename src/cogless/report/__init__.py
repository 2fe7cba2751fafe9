"""The report of a study: one offline HTML file, and still pictures."""

from cogless.report.comparison import Line, compare
from cogless.report.page import render, write
from cogless.report.verdict import Verdict, verdicts

__all__ = ["Line", "Verdict", "compare", "render", "verdicts", "write"]
