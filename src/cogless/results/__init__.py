"""Results of a study: traces, metrics, responses to faults, results.json."""

from cogless.results.runs import AnyResults, Results, Run, TrialResults

__all__ = ["AnyResults", "Results", "Run", "TrialResults"]
