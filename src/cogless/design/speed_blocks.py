"""What `cogless design` prints of a study of speed. The whole is in design_table.py."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping

from cogless.design.answers import answer
from cogless.design.blocks import Block, Blocks, margin_words
from cogless.design.design_table import notes_below, shown_gain
from cogless.design.law_rules import Gain
from cogless.design.laws.harmonic import LEARNER
from cogless.design.summary import Design, current_loop_summary, summary
from cogless.design.warnings import told_apart
from cogless.study import Study


def speed_blocks(study: Study) -> Blocks:
    """A block for each controller, then one for each current loop."""
    designs = summary(study)
    controllers = [
        Block(
            f"{study.label(name)} ({design.law}{f', {design.rule}' if design.rule else ''})",
            [
                *_answer_row(study, name, design),
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


def _answer_row(study: Study, name: str, design: Design) -> Iterator[tuple[str, str]]:
    answer_here = answer(study, name, design)
    if answer_here is not None:
        yield "settles", answer_here.words


def _gain_row(gains: Mapping[str, Gain], without: Container[str] = ()) -> Iterator[tuple[str, str]]:
    """The gains that have a unit and act. `without`: keys that only the whole table shows."""
    acting = {key: gain for key, gain in gains.items() if gain.unit and (gain.value or gain.note)}
    parts = [f"{key} {shown_gain(gain)}" for key, gain in acting.items() if key not in without]
    if parts:
        yield "gains", ", ".join(parts)
