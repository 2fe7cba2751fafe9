"""The verdict on a trial scenario: which controller needs the fewest trials to the floor after each change.

If no metric has a floor, the controllers are judged by the remaining RMS.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from cogless.design.trials.certificate import GROWTH_ROUNDING, Learning, ModelCertificate
from cogless.design.trials.gains import TrialDesign
from cogless.design.trials.response import FACTOR_ROUNDING
from cogless.report.markup import number
from cogless.report.phases import Phase, after
from cogless.report.trial_case import Case, case, same_size, than
from cogless.report.trial_certificate import Model, close_to_one
from cogless.report.verdicts import (
    EQUAL_DIFFERENCE,
    REPORTED_RATIO,
    ScenarioVerdict,
    listed,
    ratio,
    times,
    worst,
)
from cogless.results import Run, TrialResults

FEW_TRIALS = 5  # trials in a row above the feedback alone; only longer rows are reported


def verdict(results: TrialResults, runs: Sequence[Run]) -> ScenarioVerdict | None:
    """The verdict on a trial scenario; None if it has no values to judge by."""
    c = case(results, runs)
    if c is None:
        return None
    ranked = _ranked(c)
    best = ranked[0]
    tone, headline = _by_floor(c, ranked) if best in c.counts else _by_rms(c, ranked)
    if best in c.growing:  # then all do
        tone = "worse"
        every = "The error grows over the trials with every controller."
        headline = f"{_grows(c, best) if len(ranked) == 1 else every} {headline}"
    else:
        headline = " ".join(text for text in (headline, _unranked(c, ranked), _saturates(c, best)) if text)
        tone = worst(tone, "even") if c.at_limit.get(best) == c.trials else tone
    others = [name for name in ranked if name != best]
    cost = _input(c, best)
    details = [
        "" if others else "There is nothing to compare.",
        *[_behind(c, name, best) for name in others if name not in c.growing],
        *[_grows(c, name) for name in ranked if name in c.growing and others],
        _against_the_baseline(c, best),
        cost,
        *[_against_its_feedback(c, name, best) for name in ranked],
        *[_above_for_long(c, name) for name in ranked if name not in c.growing],
        *[_leaves_floor(c, name) for name in ranked],
        _at_the_limit(c),
        _held_back(c),
        *_certificates(c),
    ]
    sentences = [_capital(c, text) for text in details if text]
    sentences += [f"{line}." for line in results.without_design(c.scenario)]
    return ScenarioVerdict(c.scenario, tone, _capital(c, headline), sentences, cost=_capital(c, cost))


def _ranked(c: Case) -> list[str]:
    """Controllers, best first: not diverging, then most floors reached, fewest trials, least RMS."""

    def rank(name: str) -> tuple[float, ...]:
        counts = c.counts.get(name, [])
        reached = [n for n in counts if math.isfinite(n)]
        by_floor = (len(c.never(name)), max(reached, default=math.inf), sum(reached)) if counts else ()
        return (name in c.growing, *by_floor, c.worst(name))

    return sorted(c.counts or c.rms, key=rank)


def best_of(c: Case) -> str:
    """The best controller."""
    return _ranked(c)[0]


# --- the first sentences


def _contenders(c: Case, ranked: Sequence[str]) -> list[str]:
    """The controllers whose error doesn't grow; all if every error grows."""
    return [name for name in ranked if name not in c.growing] or list(ranked)


def _unranked(c: Case, ranked: Sequence[str]) -> str:
    """A sentence on the controllers that the ranking leaves out, since their error grows."""
    growing = [name for name in ranked if name in c.growing]
    if not growing:
        return ""
    why = "is not ranked: its error grows" if len(growing) == 1 else "are not ranked: their errors grow"
    return _capital(c, f"{c.labels(growing)} {why} over the trials.")


def _saturates(c: Case, best: str) -> str:
    """A sentence on the best controller's input, if it was at its limit in at least half of the trials."""
    count = c.at_limit.get(best, 0)
    share = "every trial" if count == c.trials else f"{count} of {c.trials} trials"
    return f"But the input of {c.label(best)} is at its limit in {share}." if 2 * count >= c.trials else ""


def _by_floor(c: Case, ranked: Sequence[str]) -> tuple[str, str]:
    """The tone and the first sentence if a metric has a floor."""
    best, base = ranked[0], c.baseline
    floor = f"the floor of {c.rms_text(c.metric.floor or 0.0)} RMS"
    passing = any(len(c.never(name)) < len(c.phases) for name in ranked if name in c.counts)
    if len(c.never(best)) == len(c.phases):
        none = "No controller reaches" if len(ranked) > 1 else f"{c.label(best)} never reaches"
        none = "No controller stays at" if passing else none
        return "worse", f"{none} {floor}.{f' {_least_rms_sentence(c, ranked)}' if best in c.rms else ''}"
    ties = [name for name in ranked if _as_quick(c, name, best)]
    are_there = f"{'are' if len(ties) > 1 else 'is'} at {floor} {_reach(c, best)}"
    if len(ranked) == 1:
        return "even", f"{c.label(best)} {are_there}."
    if ties == ranked:
        return "even", f"All controllers are alike: they {are_there}."
    if base in ties:
        behind = [name for name in _contenders(c, ranked) if name not in ties][:1]
        follows = "".join(f"; the next, {c.label(name)}, {_reach(c, name, short=True)}" for name in behind)
        first = f"No controller beats {c.label(base)}: it" if ties == [base] else c.labels(ties)
        return c.tone(ties), f"{first} {are_there}{follows}."
    against = f"; {c.label(base)} {_reach(c, base, short=True)}" if base in c.counts else ""
    return "even" if c.never(best) else c.tone(ties), f"{c.labels(ties)} {are_there}{against}."


def _by_rms(c: Case, ranked: Sequence[str]) -> tuple[str, str]:
    """The tone and the first sentence if no metric has a floor: by the worst phase's final RMS."""
    best, base = ranked[0], c.baseline
    if not math.isfinite(c.worst(best)):
        return "worse", "No error stays finite."
    sentence = _least_rms_sentence(c, ranked)
    if len(ranked) < 2 or base not in c.final:
        return "even", sentence
    if best == base:
        return "worse", f"No controller beats {c.label(base)}. {sentence}"
    ties = c.worst(base) <= (1 + EQUAL_DIFFERENCE) * c.worst(best)
    return c.tone([best, base] if ties else [best]), sentence


def _least_rms_sentence(c: Case, ranked: Sequence[str]) -> str:
    """A sentence on the controller with the least worst-phase RMS, compared with the baseline or the next."""
    base = c.baseline
    by_rms = sorted(_contenders(c, [name for name in ranked if name in c.final]), key=c.worst)
    best = by_rms[0]
    phase_words = "each phase with at most" if len(c.phases) > 1 else "with"
    sentence = _capital(c, f"{c.label(best)} ends {phase_words} {c.rms_text(c.worst(best))} RMS")
    if best != base and base in c.final:
        return f"{sentence}, {_compared_words(c, c.worst(best), c.worst(base), base)}."
    if len(by_rms) > 1:
        return f"{sentence}; the next, {c.label(by_rms[1])}, with {c.rms_text(c.worst(by_rms[1]))}."
    return f"{sentence}."


def _compared_words(c: Case, value: float, other: float, name: str) -> str:
    """A value compared with another controller's, such as "21.0 times less than PI (8.20 mrad)"."""
    if not math.isfinite(other):
        return f"against {c.label(name)} ({c.rms_text(other)})"
    as_or_than = "as" if same_size(value, other) else "than"
    return f"{than(value, other)} {as_or_than} {c.label(name)} ({c.rms_text(other)})"


def _reach(c: Case, name: str, *, short: bool = False) -> str:
    """How fast the floor is reached: "within 3 trials after every change"; `short`: as a second clause."""
    counts, never = c.counts[name], c.never(name)
    if never:
        if len(never) == len(c.phases):
            return "never reaches it"
        if short and never == list(c.phases[1:]):
            return "never reaches it after a change"
        where = f"the phase{'' if len(never) == 1 else 's'} {after(never, c.phases)}"
        return (
            f"in {len(c.phases) - len(never)} of {len(c.phases)} phases between changes, but not in {where}"
        )
    most = max(counts)
    if short:
        return f"takes {'up to ' if len(counts) > 1 else ''}{most:.0f} {'trial' if most == 1 else 'trials'}"
    if len(counts) == 1:
        return _trial_words(most)
    later = max(counts[1:])
    if counts[0] > later:
        return f"{_trial_words(counts[0])} of the start and {_trial_words(later)} after every change"
    return f"{_trial_words(later)} after every change"


def _trial_words(count: float) -> str:
    return "in the first trial" if count == 1 else f"within {count:.0f} trials"


def _as_quick(c: Case, name: str, best: str) -> bool:
    """Whether a controller ties with the best one.

    It does if both miss the floor in the same phases, need the same largest number of trials to reach it in
    the others, and its error doesn't grow.
    """
    if name == best:
        return True
    most = [max((n for n in c.counts[which] if math.isfinite(n)), default=0) for which in (name, best)]
    return c.never(name) == c.never(best) and name not in c.growing and most[0] == most[1]


# --- the others


def _behind(c: Case, name: str, best: str) -> str:
    """A sentence on a controller that is behind the best: its slowest phase and its worst first trial."""
    slower, where = "", None
    if name in c.counts and best in c.counts and name != c.baseline:
        slower, where = _slower(c, name, best)
    ratio, phase, values = c.worst_first(name, best)
    if c.learns(name) and ratio >= REPORTED_RATIO:
        place = "there" if phase == where else phase.after
        worse = f"first trial {place} is {times(ratio)} worse than with {c.label(best)} ({values})"
        return f"{c.label(name)} {slower}; its {worse}." if slower else f"With {c.label(name)} the {worse}."
    return f"{c.label(name)} {slower}." if slower else ""


def _slower(c: Case, name: str, best: str) -> tuple[str, Phase | None]:
    """A controller's trials to the floor against the best's, in words; the phase where they differ most."""
    behind = [
        (n - m, phase, n, m)
        for phase, n, m in zip(c.phases, c.counts[name], c.counts[best], strict=True)
        if n > m
    ]
    never = [phase for _, phase, n, _ in behind if not math.isfinite(n)]
    if len(never) == len(c.phases):
        return "never reaches the floor", None
    if never:
        alone = f", where {c.label(best)} does" if c.never(best) else ""
        return f"never reaches the floor {after(never, c.phases)}{alone}", never[0]
    if not behind:
        return "", None
    _, phase, n, m = max(behind, key=lambda entry: entry[0])
    return f"takes {n:.0f} trials to the floor {phase.after}, against {m:.0f}", phase


def _against_the_baseline(c: Case, best: str) -> str:
    """Sentences on the best against the baseline: RMS at the end, and a worse first trial after a change."""
    base = c.baseline
    if best == base or base not in c.final or best not in c.final or best in c.growing:
        return ""
    sentences = []
    mine, other = c.final[best][-1], c.final[base][-1]
    if best in c.counts and len(c.never(best)) < len(c.phases) and math.isfinite(mine):
        end = "In the last phase" if len(c.phases) > 1 else "At the end"
        sentences.append(
            f"{end} {c.label(best)} leaves {c.rms_text(mine)} RMS, {_compared_words(c, mine, other, base)}."
        )
    ratio, phase, values = c.worst_first(best, base)
    if ratio >= REPORTED_RATIO:
        sentences.append(
            f"What it has learned does not fit at first: in the first trial {phase.after} its error is "
            f"{times(ratio)} that of {c.label(base)} ({values})."
        )
    return " ".join(sentences)


def _against_its_feedback(c: Case, name: str, best: str) -> str:
    """A sentence on a controller against itself without learning; "" if it is neither worse nor the best."""
    above = c.all_above_feedback(name)
    if above:
        phase, mine, base = max(above, key=lambda end: ratio(*end[1:]))
        count, every = len(above), len(c.phases)
        share = f" in {count} of {every} phases, {'most ' if count > 1 else ''}{phase.after}"
        return (
            f"{c.label(name)} is worse than without learning{share if every > 1 else ''}: it ends with "
            f"{c.rms_text(mine)} RMS, and its feedback alone with {c.rms_text(base)}."
        )
    if name != best or name not in c.feedback or name not in c.final:
        return ""
    index = c.worst_phase(name)
    mine, base = c.final[name][index], c.feedback[name][index]
    where = f" {c.phases[index].after}" if len(c.phases) > 1 else ""
    return (
        f"Without learning {c.label(name)} leaves {c.rms_text(base)} RMS{where}, "
        f"with learning {c.rms_text(mine)}: {than(mine, base)}."
    )


def _above_for_long(c: Case, name: str) -> str:
    """A sentence on a controller that was above its own feedback in many trials in a row, but ends below."""
    row, peak = c.longest_above_feedback(name)
    if row <= FEW_TRIALS or c.all_above_feedback(name):
        return ""
    trial, error, base = peak
    return (
        f"{c.label(name)} is worse than its feedback alone in {row} trials in a row: "
        f"up to {c.rms_text(error)} RMS in trial {trial}, against {c.rms_text(base)}."
    )


def _input(c: Case, best: str) -> str:
    """A sentence on the RMS of the best controller's input, against the baseline's or the next's."""
    others = [name for name in c.input_rms if name != best]
    if best not in c.input_rms or not others:
        return ""
    base = c.baseline if c.baseline in others else others[0]
    quantity, unit = ("current", " A") if c.study.plant is None else ("input", "")
    mine, other = c.input_rms[best], c.input_rms[base]
    if not (math.isfinite(mine) and math.isfinite(other)):
        return ""
    comparison = f"{than(mine, other)} {'as' if same_size(mine, other) else 'than'}"
    return f"{c.label(best)} needs {number(mine)}{unit} RMS of {quantity}, {comparison} {c.label(base)}."


def _leaves_floor(c: Case, name: str) -> str:
    """A sentence on a floor that was reached early in a phase but isn't kept; "" if there is none."""
    if name not in c.counts or name not in c.final or c.metric.floor is None or name in c.growing:
        return ""
    lost = [
        (rms, phase.after)
        for phase, n, rms in zip(c.phases, c.counts[name], c.final[name], strict=True)
        if rms > (1 + EQUAL_DIFFERENCE) * c.metric.floor and n <= (phase.stop - phase.start) / 2
    ]
    if not lost:
        return ""
    rms, after = max(lost, key=lambda entry: entry[0])
    later = f"{c.rms_text(rms)} RMS in the second half of the trials {after}"
    return f"{c.label(name)} does not stay at the floor: {later}."


def _grows(c: Case, name: str) -> str:
    """A sentence on a controller whose RMS grows over the trials."""
    phase, low, high = c.growing[name]
    verb = "diverges" if c.learns(name) else "grows worse"
    if not math.isfinite(high):
        return f"{c.label(name)} {verb} {phase.after}: its error doesn't stay finite."
    to = f"from {c.rms_text(low)} to {c.rms_text(high)} by trial {phase.stop - 1}"
    return f"{c.label(name)} {verb} {phase.after}: its RMS grows {to}."


def _at_the_limit(c: Case) -> str:
    """A sentence on controllers whose input was at its limit, so that nothing was learned there."""
    limited = {name: trials for name, trials in c.at_limit.items() if trials}
    if not limited:
        return ""
    return f"The input is at its limit, where nothing is learned: {_trials(c, limited)}."


def _held_back(c: Case) -> str:
    """A sentence on controllers whose learning the guard held back."""
    held_trials = {name: trials for name, trials in c.held_back.items() if trials}
    if not held_trials:
        return ""
    return (
        f"The guard holds learning back, since learning had made the error larger: {_trials(c, held_trials)}."
    )


def _trials(c: Case, counts: Mapping[str, int]) -> str:
    return listed([f"{c.label(name)} in {trials} of {c.trials} trials" for name, trials in counts.items()])


# --- the certificates


def _certificates(c: Case) -> list[str]:
    """Sentences on the certificates of learning controllers, for the exactly sampled plant if known."""
    uncertified: dict[str, list[str]] = {}
    outside: dict[str, list[str]] = {}
    refuted: list[str] = []
    proven: dict[tuple[Model, int], list[str]] = {}
    for name, (design, model, judged_model) in c.certified.items():
        learning = judged_model.learning
        if not judged_model.stable:
            reason = (
                f"within a trial the loop is unstable for {judged_model.worst} "
                f"(largest pole {close_to_one(judged_model.radius)}; {model.words})"
            )
            uncertified.setdefault(reason, []).append(name)
        elif learning is None:
            continue
        elif not learning.monotone:
            uncertified.setdefault(f"{_growing(judged_model, learning)} ({model.words})", []).append(name)
        elif design.beyond:
            outside.setdefault(design.beyond[0], []).append(name)
        elif (why := _not_in_this_scenario(c, name, design)) is not None:
            uncertified.setdefault(why, []).append(name)
        elif name in c.growing or c.above_feedback(name) is not None:
            refuted.append(name)
        else:
            proven.setdefault((model, design.certificate.samples), []).append(name)
    sentences = [
        f"{c.labels(names)} {_are(names)} not certified: {reason}." for reason, names in uncertified.items()
    ]
    sentences += [
        f"The certificate says nothing about {c.labels(names)}: {reason}."
        for reason, names in outside.items()
    ]
    if refuted:
        sentences.append(
            f"The models certify {c.labels(refuted)}, but this run contradicts them: the run counts."
        )
    for (model, plants), names in proven.items():
        sentences.append(
            f"Certified: while nothing changes, no frequency of the error grows from trial to trial with "
            f"{c.labels(names)} ({model.words}, at its corners and at {plants} random plants); and at each "
            "corner the error of this scenario ends no higher than without learning."
        )
    return [*sentences, _delay(c)]


def _are(names: Sequence[str]) -> str:
    return "is" if len(names) == 1 else "are"


def _not_in_this_scenario(c: Case, name: str, design: TrialDesign) -> str | None:
    """A reason, by the models, why learning may not help at some corner in this scenario; None without one.

    A reason with a predicted error also has the run's error.
    """
    prediction, over_limit = design.prediction, design.over_limit
    if over_limit is not None and design.limit is not None:
        plant, most = over_limit
        unit = " A" if c.study.plant is None else ""
        return (
            f"by the models the motion needs {number(most)}{unit} at {plant}, but the limit is "
            f"{number(design.limit)}{unit}"
        )
    if prediction is not None and prediction.ends_above:
        index = prediction.worst_phase
        reason = (
            f"by the models the error may end at {number(prediction.share)} times that without learning, "
            f"{c.phases[index].after}"
        )
        if name in c.feedback and name in c.final:
            worsening = ratio(c.final[name][index], c.feedback[name][index])
            reason += f"; in this run it ends at {number(worsening)} times"
        return reason
    return None


def _growing(model: ModelCertificate, learning: Learning) -> str:
    """Why a certificate doesn't hold, in words."""
    if learning.norm > 1 + FACTOR_ROUNDING:
        where, factor = f"at {number(learning.frequency)} Hz", learning.norm
    elif model.growth is not None and model.growth > 1 + GROWTH_ROUNDING:
        where, factor = "near the beginning or the end of a trial", model.growth
    else:
        return "the matrix Φ of trial and learning together has a pole outside the unit circle"
    return f"{where} the error may grow by the factor {close_to_one(factor)} from one trial to the next"


def _delay(c: Case) -> str:
    """A sentence on controllers whose loop one more sample of delay would make unstable."""
    models = {name: model for name, (_, _, model) in c.certified.items()}
    frail = [name for name, model in models.items() if model.stable and not model.delayed_stable]
    if not frail:
        return ""
    loop = "every loop" if len(frail) == len(models) > 1 else f"the loop of {c.labels(frail)}"
    return f"One more sample of delay at the input makes {loop} unstable at some corner."


def _capital(c: Case, text: str) -> str:
    """The text with a capital first letter, unless it begins with a controller's label, as "ilc-input"."""
    first = text.partition(" ")[0]
    return text if first in map(c.label, c.runs) else text[:1].upper() + text[1:]
