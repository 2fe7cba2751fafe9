"""What `cogless design` prints of a study of speed. The whole is in design_table.py."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence

from cogless import units
from cogless.design.blocks import Block, Blocks, margin_words
from cogless.design.design_table import notes_below, shown_gain
from cogless.design.law_rules import Gain
from cogless.design.laws.harmonic import LEARNER
from cogless.design.sensor_limits import Remaining, remaining
from cogless.design.settling import Settling, left_out, settling
from cogless.design.summary import Design, current_loop_summary, summary
from cogless.design.verdict import Kind
from cogless.design.warnings import told_apart
from cogless.study import Study
from cogless.study.base import speed_text, spoken_unit
from cogless.units import ANGULAR_SPEED

# What a verdict that is no yes says, after "because".
CLAUSES: dict[Kind, str] = {
    "unstable": "it is unstable",
    "feedback unstable": "its feedback is unstable",
    "grows": "it grows",
    "may grow": "it may grow",
    "may be unstable": "it may be unstable",
}


def speed_blocks(study: Study) -> Blocks:
    """A block for each controller, then one for each current loop."""
    designs = summary(study)
    controllers = [
        Block(
            f"{study.label(name)} ({design.law}{f', {design.rule}' if design.rule else ''})",
            [
                *([("settles", _settles(study, name, design))] if study.controller[name].learned else []),
                ("margins", _margins(study, name, design)),
                *_gain_row(design.gains, without=LEARNER if design.certificate else ()),
            ],
        )
        for name, design in designs.items()
    ]
    loops = [
        Block(name, [("margins", margin_words(loop.margins)), *_gain_row(loop.gains)])
        for name, loop in told_apart(current_loop_summary(study)).items()
    ]
    return Blocks(study.title, [*controllers, *loops], notes_below(study, designs))


def _margins(study: Study, name: str, design: Design) -> str:
    return "none: it has no feedback" if study.controller[name].open_loop else margin_words(design.margins)


def _settles(study: Study, name: str, design: Design) -> str:
    """Whether learning settles, and how fast; or why not, with what repairs it."""
    law, verdict = study.controller[name], design.learning
    if not law.learns:
        return "it learned before the run, and doesn't learn in it"
    if design.certificate is not None:
        return _certified(study, name, design)
    if verdict is None:
        return "not judged: it is a law of the study's own"
    if verdict.kind == "settles":
        harm = verdict.short().removeprefix("settles")
        rest = verdict.words().removeprefix(verdict.short())
        return f"yes{_times(study, name, design)}{harm}{rest}{_reach(study, design)}"
    if verdict.kind in CLAUSES:
        return f"no, because {CLAUSES[verdict.kind]}{verdict.words().removeprefix(verdict.kind)}"
    return "; ".join(["it learns nothing", *verdict.frozen]) if verdict.kind == "rests" else verdict.words()


def _certified(study: Study, name: str, design: Design) -> str:
    """The answer for `harmonic`, of which the certificate speaks."""
    assert design.certificate is not None
    speeds = design.certificate.speeds
    if not speeds or all(speed.snaps is not None for speed in speeds):
        return design.certificate.words()
    orders = design.certificate.learner.order_words
    if design.certificate.fine:
        settles = f"yes, {orders}{_times(study, name, design)}{_reach(study, design)}"
        return _beside_sensor(study, remaining(study, name, design.certificate), settles)
    bad = next(speed for speed in speeds if not speed.fine)
    at = speed_text(study, bad.omega_m)
    if bad.snaps is not None:
        return f"no, because {bad.snaps}"
    if bad.gamma <= 0:
        return f"no, because at {at} not all orders need converge where the inertia is 50 % off"
    return f"no, because at {at} the orders together settle only at rates to {bad.most:.3g} 1/s"


def _beside_sensor(study: Study, speeds: Sequence[Remaining], settles: str) -> str:
    """The answer for orders that settle, with what the position sensor leaves of it at some speed."""
    coarse = next((speed for speed in speeds if not speed.modelled), None)
    little = next((speed for speed in speeds if not speed.worth_it), None)
    if little is not None:
        parts = {
            "the position sensor's steps": little.steps,
            "the position sensor's error": little.error,
            "orders that it does not learn": little.unlearned,
        }
        learned, alone = (speed_text(study, size, 3) for size in (little.learned, little.alone))
        compared = f"it leaves {learned} of ripple, feedback alone {alone}"
        by = max(parts, key=lambda part: parts[part])
        answer = f"not worth it: at {speed_text(study, little.omega_m)} {compared}. Most is by {by}"
        return answer if coarse is None else f"{answer}; and {_too_coarse(study, coarse)}"
    if coarse is None:
        return settles
    return f"not sure: {_too_coarse(study, coarse)}; a run tells. By small signals {settles}"


def _too_coarse(study: Study, coarse: Remaining) -> str:
    """Why learning may do harm with a coarse sensor, as a clause."""
    few = f"at {speed_text(study, coarse.omega_m)} {coarse.counts:.2g} counts come in a speed sample"
    return f"{few}, so it may take the position sensor's steps for motion"


def _times(study: Study, name: str, design: Design) -> str:
    """In which time it settles, at the slowest and the fastest speed that is held; "" if that is unknown."""
    times_held = settling(study, name, design.certificate)
    times = [
        f"{_rounded_time(held_speed.time)} at {speed_text(study, held_speed.omega_m)}"
        for held_speed in times_held
    ]
    if not times:
        return ""
    lacks = left_out(study, name)
    slower = f" or later (not in the model: {', '.join(lacks)})" if lacks else ""
    ends = "".join(_ends_before(study, name, held_speed) for held_speed in times_held)
    return f", in about {' and '.join(times)}{slower}{ends}"


def _ends_before(study: Study, name: str, settled: Settling) -> str:
    """The scenario that ends before learning has settled, as a clause; "" if one lasts as long."""
    at_speed = {
        key: study.scenario[key].duration
        for key in study.scenarios_of(name)
        if study.scenario[key].slowest == settled.omega_m == study.scenario[key].top_reference
    }
    longest = max(at_speed, key=lambda key: at_speed[key])
    if at_speed[longest] >= settled.time:
        return ""
    return f"; too late for scenario {longest}, which lasts {at_speed[longest]:.3g} s"


def _rounded_time(time: float) -> str:
    """A time in one digit, or in two that begin with 1 or 2, such as "2.4 s", "30 s" or "0.5 s"."""
    digits = 2 if 1 <= float(f"{time:.1e}".partition("e")[0]) < 3 else 1
    return f"{float(f'{time:.{digits}g}'):g} s"


def _reach(study: Study, design: Design) -> str:
    """Up to which speed it learns, in three digits."""
    fastest = design.certificate.fastest if design.certificate is not None else design.fastest
    if fastest is None:
        return ""
    unit = spoken_unit(study, ANGULAR_SPEED)
    rounded = float(f"{units.convert(fastest, unit, ANGULAR_SPEED):.3g}")
    return f"; it learns up to {rounded:g} {unit}"


def _gain_row(gains: Mapping[str, Gain], without: Container[str] = ()) -> Iterator[tuple[str, str]]:
    """The gains that have a unit and act. `without`: keys that only the whole table shows."""
    acting = {key: gain for key, gain in gains.items() if gain.unit and (gain.value or gain.note)}
    parts = [f"{key} {shown_gain(gain)}" for key, gain in acting.items() if key not in without]
    if parts:
        yield "gains", ", ".join(parts)
