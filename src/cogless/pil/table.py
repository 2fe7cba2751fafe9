"""Show a comparison as lines of text."""

from __future__ import annotations

from cogless.pil.compare import Comparison, Difference, Instructions


def lines(found: Comparison) -> list[str]:
    """Lines that `cogless pil` prints."""
    rows = [
        ("compared", f"{found.ticks} periods of {found.study}, {found.scenario}/{found.controller}"),
        ("result", "every output and what was learned: bit for bit equal"),
        ("instructions", _instructions(found.all)),
        ("  with the law", _instructions(found.with_law)),
        ("  without", _instructions(found.without_law)),
        ("  where, with", _sources(found.by_source_with_law)),
        ("  where, without", _sources(found.by_source_without_law)),
        ("  end of a trial", str(found.end_of_trial or "")),
        ("stack", f"{found.stack} bytes"),
        ("flash", f"{found.flash} bytes, {found.constants} of them the configured constants"),
        ("RAM", f"{found.ram} bytes, {found.memory} of them what the law learns into"),
        ("compiler", f"{found.compiler} {found.flags}"),
    ]
    if found.difference is not None:
        rows[1] = ("result", _difference(found.difference, found.ticks))
    return [f"{name:<18}{value}" for name, value in rows if value]


def _difference(d: Difference, ticks: int) -> str:
    where = "at the end" if d.tick == ticks else f"period {d.tick}"
    return f"NOT equal: {where}: {d.field}: simulation {d.simulation!r}, processor {d.processor!r}"


def _instructions(found: Instructions | None) -> str:
    return f"{found.least} to {found.most}, mean {found.mean:.1f}" if found else ""


def _sources(by_source: dict[str, float]) -> str:
    return ", ".join(f"{name} {count:.0f}" for name, count in by_source.items() if count >= 0.5)
