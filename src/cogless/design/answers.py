"""What `cogless design` answers of a speed controller's learning: in a sentence, and as numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from cogless import units
from cogless.catalogue import sensor_bits
from cogless.design.angle_functions import functions_in
from cogless.design.back_emf import is_covered, is_unstable_with_back_emf, response_factors
from cogless.design.changes import cure_words, either, first
from cogless.design.current_needed import noisy_voltage
from cogless.design.gentler import other_law_rates
from cogless.design.laws.harmonic import Certificate, certificate, learner
from cogless.design.margins import finite
from cogless.design.sensor_limits import Remaining, remaining
from cogless.design.settling import Settling, left_out, settling
from cogless.design.speed_loop import BELIEF_FACTORS, speed_loop
from cogless.design.summary import Design, current_loop_dict, design, design_dict, summary
from cogless.design.verdict import Kind
from cogless.study import Study
from cogless.study.base import StudyBase, speed_text, spoken_unit
from cogless.study.numerics import voltage_reach
from cogless.study.position_sensor import Hall
from cogless.study.reading import Changes
from cogless.units import ANGULAR_SPEED

# The clause after "because" in an answer "no", by the kind of the verdict on learning.
CLAUSES: dict[Kind, str] = {
    "unstable": "it is unstable",
    "feedback unstable": "its feedback is unstable",
    "grows": "what it learns grows",
    "may grow": "what it learns may grow",
    "may be unstable": "it may be unstable",
}
AnswerVerdict = Literal["yes", "no", "not worth it", "not sure", "not judged"]


@dataclass(frozen=True)
class Answer:
    """Whether a controller's learning settles and is worth it."""

    verdict: AnswerVerdict  # "no" also where nothing is learned in a run
    words: str  # the whole answer; it begins with the verdict, unless nothing is learned
    settling: Sequence[Settling] = ()  # times in which learning settles, at constant speeds
    left_out: Sequence[str] = ()  # what the drive has and the model of `settling` lacks
    remaining: Sequence[Remaining] = ()  # ripple with `harmonic` and a sensor of counts
    cures: Sequence[Changes] = ()  # each of them makes the verdict "yes"
    doubt: str = ""  # why the verdict is not sure, as a clause

    @property
    def reason(self) -> str:
        """The words after the verdict."""
        return self.words.removeprefix(self.verdict).lstrip(",:; ").removeprefix("because ")


def doubt(study: Study, name: str, scenario: str) -> str:
    """Why the design is not sure of a controller's learning in a scenario, as a clause; "" if it is sure."""
    own_answer = answer_of(study, name, scenario)
    return own_answer.doubt if own_answer is not None else ""


def other_seeds(study: StudyBase) -> tuple[int, int]:
    """Two seeds other than the study's, for further runs where, by `doubt`, a single run may mislead."""
    first, second, *_ = (seed for seed in range(3) if seed != study.seed)
    return first, second


def answer_of(study: Study, name: str, scenario: str = "") -> Answer | None:
    """The answer for a controller that learns while it runs; None for another.

    `scenario`: the answer is about this scenario's speeds; "": about those of all its scenarios.
    """
    if not study.controller[name].learns:
        return None
    own_design = design(study, name)
    if scenario and own_design.certificate is not None:
        return _certified(study, name, _in_scenario(study, own_design.certificate, scenario), [scenario])
    return answer(study, name, own_design)


def _in_scenario(study: Study, certified: Certificate, scenario: str) -> Certificate:
    """The certificate at the speeds of a scenario alone."""
    low, high = study.scenario[scenario].slowest, study.scenario[scenario].top_reference
    return replace(certified, speeds=tuple(at for at in certified.speeds if low <= at.omega_m <= high))


def to_dict(study: Study) -> dict[str, Any]:
    """The design of a study as plain types in SI units, for JSON; a number that doesn't exist is null."""
    return {
        "study": study.title,
        "current_loop": current_loop_dict(study),
        "speed_loop": {"period": speed_loop(study).period, **dataclasses.asdict(speed_loop(study))},
        "controllers": {
            name: {**design_dict(design), "answer": _answer_dict(answer(study, name, design))}
            for name, design in summary(study).items()
        },
    }


def _answer_dict(answer: Answer | None) -> dict[str, Any] | None:
    if answer is None:
        return None
    return {
        "verdict": answer.verdict,
        "reason": answer.reason,
        "settling": [
            {
                "omega_m_rad_s": at_speed.omega_m,
                "time_s": at_speed.time,
                "scenario": at_speed.scenario,
                "duration_s": at_speed.duration,
                "in_time": at_speed.in_time,
            }
            for at_speed in answer.settling
        ],
        "not_in_model": list(answer.left_out),
        "ripple": [
            {
                "omega_m_rad_s": at_speed.omega_m,
                "alone_rad_s": at_speed.alone,
                "learned_rad_s": at_speed.learned,
                "sensor_steps_rad_s": at_speed.steps,
                "sensor_error_rad_s": at_speed.error,
                "unlearned_orders_rad_s": at_speed.unlearned,
                "current_noise_rad_s": at_speed.noise,
                "counts_per_sample": finite(at_speed.counts),
                "steps_density": at_speed.steps_density,
                "steps_learning_rad_s": at_speed.steps_learning,
                "worth_it": at_speed.worth_it,
                "modelled": at_speed.modelled,
            }
            for at_speed in answer.remaining
        ],
        "cures": [dict(change) for change in answer.cures],
    }


def answer(study: Study, name: str, design: Design) -> Answer | None:
    """The answer for a controller, with what repairs its learning; None if no part of its law is learned."""
    law, verdict = study.controller[name], design.learning
    if not law.learned:
        return None
    if not law.learns:
        return Answer("no", "it learned before the run, and does not learn during the run")
    if is_unstable_with_back_emf(study, name):
        return Answer("no", "no, because its feedback is unstable with the motor's back-EMF")
    if design.certificate is not None:
        return _certified(study, name, design.certificate, study.scenarios_of(name))
    if verdict is None:
        return Answer("not judged", "not judged: the law is the study's own code")
    if verdict.kind == "settles":
        harm = verdict.short().removeprefix("settles")
        rest = verdict.in_words().removeprefix(verdict.short())
        times, lacks = settling(study, name), left_out(study, name)
        reach = _reach(study, design.fastest)
        return Answer("yes", f"yes{_times(study, times, lacks)}{harm}{rest}{reach}", times, lacks)
    if verdict.kind in CLAUSES:
        clause = f"{CLAUSES[verdict.kind]}{verdict.in_words().removeprefix(verdict.kind)}"
        return Answer("no", f"no, because {clause}")
    if verdict.kind == "rests":
        return Answer("no", "; ".join(["it learns nothing", *verdict.frozen]))
    return Answer("not judged", verdict.in_words())


def _certified(study: Study, name: str, certificate: Certificate, scenarios: Sequence[str]) -> Answer:
    """The answer for a controller with the law `harmonic` in scenarios, from its certificate."""
    speeds = certificate.speeds
    if not speeds or all(speed.snaps is not None for speed in speeds):
        return Answer("not judged", certificate.in_words())
    if certificate.fine:
        times, lacks = settling(study, name, certificate), left_out(study, name)
        reach = _reach(study, certificate.fastest)
        settles = f"yes, {certificate.learner.order_words}{_times(study, times, lacks)}{reach}"
        at_speeds = remaining(study, name, certificate)
        doubt = _limited_voltage(study, scenarios) or _heavier_than_certified(study, certificate)
        cures = () if doubt else _quieter_rates(study, name, at_speeds)
        worthless = "" if doubt else _not_worth_it(study, at_speeds)
        if orders := _learned_in_vain(study, name):
            worthless, cures = orders, _encoders(study, name)
            worthless += f"; with {either(cures)} it would be worth it" if cures else ""
        if worthless:
            return Answer(
                "not worth it", worthless, settling=times, left_out=lacks, remaining=at_speeds, cures=cures
            )
        doubt = doubt or _coarse_doubt(study, at_speeds, cures)
        if doubt:
            seeds = "runs with several seeds (--set seed=1, --set seed=2, ...) show whether learning helps"
            words = f"not sure: {doubt}; {seeds}. Without this effect the answer is {settles}"
            return Answer(
                "not sure",
                words,
                settling=times,
                left_out=lacks,
                remaining=at_speeds,
                cures=cures,
                doubt=doubt,
            )
        return Answer("yes", settles, times, lacks, at_speeds)
    bad = next(speed for speed in speeds if not speed.fine)
    at = speed_text(study, bad.omega_m)
    if bad.snaps is not None:
        return Answer("no", f"no, because {bad.snaps}")
    if bad.gamma <= 0:
        return Answer("no", f"no, because at {at} some orders may not converge if the inertia is 50 % off")
    return Answer(
        "no",
        f"no, because at {at} the learning rate is {bad.rate:.3g} 1/s, but learning all orders together is "
        f"stable only up to {bad.most:.3g} 1/s",
    )


def _limited_voltage(study: Study, scenarios: Sequence[str]) -> str:
    """How noise takes the voltage to its limit, so that little is learned, as a clause; "" if it doesn't."""
    limited = ((scenario, noisy_voltage(study, scenario)) for scenario in scenarios)
    return next((f"in {scenario} {remark}" for scenario, remark in limited if remark is not None), "")


def _heavier_than_certified(study: Study, certificate: Certificate) -> str:
    """How the back-EMF changes the response beyond the certificate, as a clause; "" if it doesn't."""
    for speed in certificate.speeds:
        orders = certificate.learned_orders(speed)
        factors = response_factors(study, orders * speed.omega_m)
        beyond = np.flatnonzero(~is_covered(factors))
        if len(beyond):
            order, factor = int(orders[beyond[0]]), factors[beyond[0]]
            return (
                f"at {speed_text(study, speed.omega_m)} the motor's back-EMF multiplies the speed's response "
                f"to a current of order {order} by {factor:.2g}; learning surely converges only for factors "
                f"from {min(BELIEF_FACTORS):g} to {max(BELIEF_FACTORS):g}"
            )
    return ""


def _quieter_rates(study: Study, name: str, speeds: Sequence[Remaining]) -> tuple[Changes, ...]:
    """The change to the nearest rate of the law at which the sensor's steps don't disturb learning.

    Empty: the steps don't disturb learning now, or no rate that is tried helps.
    """
    if all(speed.modelled or not speed.worth_it or speed.few_counts for speed in speeds):
        return ()

    def is_quiet(other: Study) -> bool:
        certified = certificate(other, name)
        after = remaining(other, name, certified)
        return certified.fine and all(speed.modelled and speed.worth_it for speed in after)

    return first(study, other_law_rates(study), is_quiet)


def _learned_in_vain(study: Study, name: str) -> str:
    """The answer where the torque has no order that `harmonic` learns; "" if it has one, or may have it.

    A torque constant that ripples has sums and differences of orders, and an angle table has all of them.
    """
    of_scenarios = [functions_in(study, scenario) for scenario in study.scenarios_of(name)]
    orders = sorted({order for functions in of_scenarios for order in functions.torque.orders})
    own_learner = learner(study, name)
    is_clear = not any(functions.K.orders or functions.torque.table for functions in of_scenarios)
    if not orders or not is_clear or any(own_learner.learns(order) for order in orders):
        return ""
    has = f"order{'s' * (len(orders) > 1)} {', '.join(map(str, orders))}"
    return f"not worth it: the law learns {own_learner.order_words}, but the torque has only {has}"


def _encoders(study: Study, name: str) -> tuple[Changes, ...]:
    """The change from Hall sensors to the coarsest encoder of the catalogue that makes learning worth it."""
    if not isinstance(study.drive.position_sensor, Hall):
        return ()

    def is_worth_it(other: Study) -> bool:
        cured = answer_of(other, name)
        return cured is not None and cured.verdict == "yes"

    bits = sorted({*sensor_bits().values()})
    return first(
        study, ({"drive.position_sensor": {"kind": "absolute", "bits": n}} for n in bits), is_worth_it
    )


def _not_worth_it(study: Study, speeds: Sequence[Remaining]) -> str:
    """The answer where learning takes away too little of the ripple at some speed; "" if it does not."""
    little = next((speed for speed in speeds if not speed.worth_it), None)
    if little is None:
        return ""
    parts = {
        "the position sensor's steps": little.steps,
        "the position sensor's error": little.error,
        "orders that the law does not learn": little.unlearned,
        "noise of the current sensors": little.noise,
    }
    learned, alone = (speed_text(study, size, 3) for size in (little.learned, little.alone))
    compared = f"learning leaves {learned} of ripple, and the feedback alone leaves {alone}"
    by = max(parts, key=lambda part: parts[part])
    at = speed_text(study, little.omega_m)
    answer = f"not worth it: at {at} {compared}. Most of what learning leaves comes from {by}"
    coarse = _coarse_doubt(study, speeds, ())
    return f"{answer}; and {coarse}" if coarse else answer


def _coarse_doubt(study: Study, speeds: Sequence[Remaining], cures: Sequence[Changes]) -> str:
    """Why learning may do harm with a coarse sensor at some speed, and what avoids it; "" if it may not."""
    coarse = next((speed for speed in speeds if not speed.modelled), None)
    if coarse is None:
        return ""
    return _too_coarse(study, coarse) + cure_words(cures)


def _too_coarse(study: Study, coarse: Remaining) -> str:
    """Why learning may do harm with a coarse sensor, as a clause."""
    at = f"at {speed_text(study, coarse.omega_m)}"
    if coarse.few_counts:
        return (
            f"{at} the position sensor gives {coarse.counts:.2g} counts per speed sample, so the law may "
            "take the sensor's steps for motion"
        )
    steps, alone = (speed_text(study, size, 3) for size in (coarse.steps_learning, coarse.alone))
    ripple = (
        f"{at} the position sensor's steps cause {steps} of ripple while the law learns; the feedback "
        f"alone leaves {alone}"
    )
    if coarse.beat is None:
        return ripple
    return (
        f"{ripple}. The sensor's {coarse.counts * coarse.law_rate:.0f} steps a second, sampled by the law at "
        f"{coarse.law_rate:.0f} Hz, alias to {coarse.beat:.0f} Hz, which the law mistakes for motion"
    )


def _times(study: Study, times: Sequence[Settling], lacks: Sequence[str]) -> str:
    """The times in which learning settles at the slowest and fastest constant speed; "" if unknown."""
    if not times:
        return ""
    words = [
        f"{_rounded_time(at_speed.time)} at {speed_text(study, at_speed.omega_m)}{_end(at_speed)}"
        for at_speed in times
    ]
    slower = f"; it may take longer (the estimate leaves out {', '.join(lacks)})" if lacks else ""
    return f", in about {' and '.join(words)}{slower}"


def _end(at_speed: Settling) -> str:
    """The note that learning settles after the scenario's end; "" if it settles before."""
    if at_speed.in_time:
        return ""
    return f" (scenario {at_speed.scenario} lasts only {at_speed.duration:.3g} s)"


def _rounded_time(time: float) -> str:
    """A time in one digit, or in two that begin with 1 or 2, such as "2.4 s", "30 s" or "0.5 s"."""
    digits = 2 if 1 <= float(f"{time:.1e}".partition("e")[0]) < 3 else 1
    return f"{float(f'{time:.{digits}g}'):g} s"


def _reach(study: Study, fastest: float | None) -> str:
    """Words: the speed, in three digits, up to which the law learns; "" if the bus voltage allows less."""
    if fastest is None or fastest > voltage_reach(study):
        return ""
    unit = spoken_unit(study, ANGULAR_SPEED)
    rounded = float(f"{units.convert(fastest, unit, ANGULAR_SPEED):.3g}")
    return f"; it learns up to {rounded:g} {unit}"
