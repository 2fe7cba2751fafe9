"""What `cogless design` prints of a study of trials: a block for each controller, its answer first.

The whole, with the certificate's numbers, is the tables of trial_summary.py.
"""

from __future__ import annotations

from cogless.design.blocks import Block, Blocks
from cogless.design.trials.gains import TrialDesign
from cogless.design.trials.prediction import PHASE_TRIALS
from cogless.design.trials.response import FACTOR_ROUNDING
from cogless.design.trials.trial_summary import (
    TrialSummary,
    gain_cells,
    labelled_notes,
    plant_words,
)
from cogless.study import TrialStudy


def trial_blocks(study: TrialStudy, summary: TrialSummary) -> Blocks:
    """A block for each controller, and the plant in one line below them."""
    blocks = [Block(study.label(name), _design_rows(design)) for name, design in summary.designs.items()]
    blocks += [
        Block(study.label(name), [("design", f"none: {why}")]) for name, why in summary.without.items()
    ]
    notes = [plant_words(summary.plant), *labelled_notes(study, summary.designs)]
    return Blocks(study.title, blocks, notes)


def _design_rows(design: TrialDesign) -> list[tuple[str, str]]:
    feedback, static, learning, *_ = gain_cells(design)
    settles = [("settles", _settles(design))] if design.learns or design.no_K_3 else []
    gains = f"{feedback}, N {static}" if design.gains.observer is not None else f"K_s {feedback}, N {static}"
    gains += f", K_3 {learning}" if settles else ""
    return [*settles, ("margins", _margins(design)), ("gains", gains)]


def _settles(design: TrialDesign) -> str:
    """Whether learning is certified, and after how many trials it is there; or why not."""
    reason = why_not(design)
    answer = "yes, certified" if reason is None else f"no, because {reason}"
    prediction = design.prediction
    if prediction is None or prediction.ends_above:
        return answer
    counts = prediction.trials_to_floor
    trials = ", ".join(f"more than {PHASE_TRIALS}" if count is None else f"{count}" for count in counts)
    phases, end = "", "the scenario"
    if len(counts) > 1:
        phases, end = f" in the scenario's {len(counts)} phases", "each phase"
    return (
        f"{answer}; the error stops falling after {trials} trials{phases}; at the end of {end} at most "
        f"{100 * prediction.share:.3g} % of the error without learning is left"
    )


def why_not(design: TrialDesign) -> str | None:
    """Why a design isn't certified, as a clause; None if it is."""
    if design.certified:
        return None
    part, prediction = design.certificate.deciding, design.prediction
    if not part.stable:
        poles = f"largest magnitude of a pole {part.radius:.4g}"
        return f"within a trial the feedback loop is unstable for {part.worst} ({poles})"
    if design.no_K_3 or part.learning is None:
        return "no K_3 makes every error smaller"
    if not part.learning.monotone:
        factor = f", at {part.learning.frequency:.4g} Hz by the factor {part.learning.norm:.6g}"
        grows = part.learning.norm > 1 + FACTOR_ROUNDING
        return f"an error may grow from trial to trial{factor if grows else ''}"
    if design.beyond:
        return design.beyond[0]
    if prediction is None:
        return "the scenario can't be predicted"
    if design.over_limit is not None:
        plant, most = design.over_limit
        return f"at {plant} the motion needs an input of {most:.4g}, above the limit of {design.limit:.4g}"
    return f"in this scenario learning may leave {prediction.share:.3g} times the error without learning"


def _margins(design: TrialDesign) -> str:
    part = design.certificate.deciding
    own = f"largest pole along the trial {part.radius:.3f}{'' if part.stable else ', unstable'}"
    late = f"{part.delayed_radius:.3f}{'' if part.delayed_stable else ', unstable'}"
    return f"{own}; with one more sample of delay {late}"
