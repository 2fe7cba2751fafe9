"""The report of a sweep: its answer is that of the table, and its commands repeat what they say they do."""

import json
import math
import re
import shlex
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import ensembles
import numpy as np
import pytest
from commands import cogless

import studies
from cogless.ensemble import judge
from cogless.ensemble import sweep as sweeping
from cogless.ensemble.judge import influences, positions
from cogless.ensemble.sweep_table import Column, Sweep, columns
from cogless.ensemble.variants import draw
from cogless.report import sweep_report as report
from cogless.study.metric import LAST_TRIAL

pytest.importorskip("SALib", reason="needs the extra cogless[sweep]")


def made(folder: Path, count: int, values: Any, vary: str | None = None) -> Sweep:
    """A sweep whose ripple, rad/s, is a function of inertia and friction, as shares of their ranges."""
    study = ensembles.study(folder, vary=vary)
    ensemble = draw(study, count)
    shares = [np.argsort(np.argsort(ensemble.si[key])) / count for key in ensemble.drawn]
    found = np.full((count, 2, 3), 0.1)
    found[:, 0, 0] = values(*shares)
    return Sweep(study, ensemble, [("low", "pi"), ("low", "pi-ilc")], columns(study), found, {})


@pytest.mark.parametrize(("a", "b"), [(1.0, 0.0), (1.0, 1.0), (3.0, 1.0)])
def test_sobol_indices_of_a_sum_are_the_shares_of_its_variance(tmp_path: Path, a: float, b: float) -> None:
    sweep = made(tmp_path, 1024, lambda x, y: a * x + b * y)
    first, second = influences(sweep, 0, 0)
    assert (first.key, second.key) == ("mechanics.inertia", "mechanics.viscous_friction")
    assert first.first == pytest.approx(a**2 / (a**2 + b**2), abs=0.03)
    assert second.first == pytest.approx(b**2 / (a**2 + b**2), abs=0.03)
    assert first.rank is not None and (first.rank == pytest.approx(1.0)) == (b == 0)


def test_what_only_acts_together_explains_nothing_alone(tmp_path: Path) -> None:
    sweep = made(tmp_path, 1024, lambda x, y: (x - 0.5) * (y - 0.5))
    assert [one.first for one in influences(sweep, 0, 0)] == pytest.approx([0, 0], abs=0.03)


def test_a_falling_metric_has_a_negative_rank_and_a_flat_one_none(tmp_path: Path) -> None:
    sweep = made(tmp_path, 64, lambda x, y: -(x**3))
    assert influences(sweep, 0, 0)[0].rank == pytest.approx(-1.0)
    assert [(one.rank, one.first) for one in influences(sweep, 1, 0)] == [(None, None)] * 2
    assert influences(sweep, 0, 0)[0].first is None  # too few for it


def test_spreads_by_hand(tmp_path: Path) -> None:
    limit = ensembles.study(tmp_path).metric[0].limit
    assert limit == pytest.approx(0.1 * np.pi)
    sweep = made(tmp_path, 100, lambda x, y: 2 * limit * x)  # 0, 0.01, ... of twice the limit
    sweep.values[np.argmin(sweep.values[:, 0, 0]), 0, 0] = np.nan  # one fails, which is worse than all
    found = judge.spreads(sweep, "low")[0][0]
    assert found.within == pytest.approx(0.5) and found.failed == 1  # 1 to 50 of 100
    assert found.median == pytest.approx(2 * limit * 0.50) and found.edge == pytest.approx(2 * limit * 0.95)
    assert np.isnan(sweep.values[found.worst, 0, 0]) and found.worst_value == np.inf


@pytest.mark.parametrize(
    ("share", "count", "low", "high"),
    [(0.5, 100, 0.4038, 0.5962), (0.0, 64, 0.0, 0.0566), (0.9, 10, 0.5958, 0.9821)],
)
def test_the_interval_of_a_share_is_wilsons(share: float, count: int, low: float, high: float) -> None:
    assert judge.likely(share, count) == pytest.approx((low, high), abs=2e-4)


def test_the_interval_of_none_and_all_is_within_none_and_all() -> None:
    for count in range(1, 200):
        assert judge.likely(0.0, count)[0] >= 0.0 and judge.likely(1.0, count)[1] <= 1.0


def test_a_quantile_is_of_the_values() -> None:
    """Seven of a hundred, although 0.07 times 100 is a hair more."""
    values = np.arange(100.0, 0.0, -1.0)
    assert [judge.quantile(values, share) for share in (0.0, 0.07, 0.0701, 1.0)] == [1, 7, 8, 100]


def test_influence_needs_enough_numbers_that_differ(tmp_path: Path) -> None:
    """10 variants for a rank, 200 for a share of variance. The seed is no key, a constant tells nothing."""
    vary = """[vary]
seeds = true
mechanics.inertia = { uniform = "20 %" }
motor.pole_pairs = { list = [4] }
motor.winding = { list = ["star", "delta"] }
controller.pi-ilc.cells = { list = [32, 128] }"""
    sweeps = {n: made(tmp_path, n, lambda x, *others: x, vary) for n in (9, 10, 199, 200)}
    found = {n: influences(sweep, 0, 0) for n, sweep in sweeps.items()}
    assert [one.key for one in found[9]] == [
        "mechanics.inertia", "motor.pole_pairs", "motor.winding", "controller.pi-ilc.cells"
    ]  # fmt: skip
    assert found[9][0].rank is None and found[10][0].rank == pytest.approx(1.0)
    assert found[199][0].first is None and found[200][0].first == pytest.approx(1.0, abs=0.05)
    assert [(n[1].rank, n[1].first) for n in found.values()] == [(None, None)] * 4
    assert set(positions(sweeps[9], "motor.winding")) == {0.0, 1.0}
    assert set(positions(sweeps[9], "controller.pi-ilc.cells")) == {32.0, 128.0}
    sweeps[10].values[3, 0, 0] = np.inf
    assert influences(sweeps[10], 0, 0)[0].rank is None


def test_a_list_without_the_number_has_none(tmp_path: Path) -> None:
    (first, second) = (c for c in columns(ensembles.study(tmp_path)) if c.metric.kind == "order")
    assert (first.name, second.spoken) == ("speed_rad_s.24", "speed.48")
    assert first.number_in({"speed_rad_s": [0.5]}) == 0.5
    assert second.number_in({"speed_rad_s": [0.5]}) is None and second.number_in({}) is None
    assert first.number_in({"speed_rad_s": [math.inf, 1.0]}) is None


def test_values_as_toml() -> None:
    import tomllib

    for value in (1, 0.5, True, 'a "b" \\ c', [1, "x"], {"a": 1, "b": [2.5]}):
        assert tomllib.loads(f"x = {judge.toml(value)}") == {"x": value}


def page(sweep: Sweep, folder: Path) -> str:
    report.write(sweep, folder / "report.html", lambda settings, pair: "")
    return (folder / "report.html").read_text()


def test_the_page_says_when_there_are_too_few_variants(tmp_path: Path) -> None:
    few, enough = (page(made(tmp_path, n, lambda x, y: x), tmp_path) for n in (64, 200))
    assert "64 variants are too few for Sobol indices: expected 200 or more." in few
    assert "too few" not in enough


def test_the_page_draws_every_variant(tmp_path: Path) -> None:
    text = page(made(tmp_path, 64, lambda x, y: x), tmp_path)
    found = re.search(r'id="data">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    (shown,) = json.loads(found[1])["scenarios"]
    assert [len(chart["xs"]) for chart in shown["scatter"]] == [64, 64]
    assert shown["scatter"][0]["x"] == "mechanics.inertia (kg·m²)"  # it explains more
    assert shown["scatter"][0]["xs"] == sorted(shown["scatter"][0]["xs"])
    assert shown["spreads"][0]["limit"] == pytest.approx(3)


def test_a_large_sweep_is_drawn_in_part(tmp_path: Path) -> None:
    """Three metrics of four, four keys of five, the strongest first, and 600 points of 700."""
    vary = """[vary]
mechanics.inertia = { uniform = "20 %" }
mechanics.viscous_friction = { uniform = "20 %" }
controller.pi.kp = { uniform = "20 %" }
controller.pi.ki = { uniform = "20 %" }
controller.pi-ilc.gain = { uniform = "20 %" }"""
    sweep = made(tmp_path, 700, lambda a, b, c, d, e: a + 2 * b + 3 * c + 4 * d + 5 * e, vary)
    ripple, orders = sweep.study.metric
    of_three = orders.model_copy(update={"order": (24, 48, 72), "limit": 0.15})
    study = sweep.study.model_copy(update={"metric": (ripple, of_three)})
    four = np.concatenate((sweep.values, sweep.values[:, :, :1]), axis=2)
    text = page(replace(sweep, study=study, columns=columns(study), values=four), tmp_path)
    (shown,) = json.loads(re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1])["scenarios"]
    assert [chart["title"] for chart in shown["spreads"]] == [
        f"{name}: share of variants" for name in ("ripple", "speed: order 24", "speed: order 48")
    ]
    of_ripple = [chart for chart in shown["scatter"] if chart["quantity"] == "ripple"]
    keys = ("controller.pi-ilc.gain", "controller.pi.ki", "controller.pi.kp", "mechanics.viscous_friction")
    assert [chart["title"] for chart in of_ripple] == [f"ripple over {key}" for key in keys]
    assert {len(chart["xs"]) for chart in (*shown["spreads"], *of_ripple)} == {600}


def test_one_controller_has_its_plots_too(tmp_path: Path) -> None:
    both = linear(tmp_path)
    text = page(replace(both, pairs=both.pairs[:1], values=both.values[:, :1]), tmp_path)
    assert '<section class="answer even"' in text  # nothing is beaten
    found = re.search(r'id="data">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    (shown,) = json.loads(found[1])["scenarios"]
    assert [len(chart["series"]) for chart in shown["spreads"]] == [1]


def test_the_worst_command_repeats_the_worst_variant(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    vary = ensembles.VARY + 'controller.pi.kp = { uniform = "30 %" }\nseeds = true\n'
    studies.write(tmp_path, ensembles.TEXT.replace(ensembles.VARY, vary))
    options = ("--set", "mechanics.load.torque=0.01 N*m")
    code, _, err = cogless(capsys, "sweep", "study.toml", "-n", 20, "-o", "out", "-j", 1, *options)
    assert (code, err) == (0, "")
    import pyarrow.parquet as pq

    rows = pq.read_table(tmp_path / "out" / "sweep.parquet").to_pylist()
    commands = re.findall(r"<code>(cogless run .*?)</code>", (tmp_path / "out" / "report.html").read_text())
    assert len(commands) == 2
    for command, controller in zip(commands, ("pi", "pi-ilc"), strict=True):
        worst = max(row["ripple_rad_s"] for row in rows if row["controller"] == controller)
        assert cogless(capsys, *shlex.split(unescape(command))[1:], "-o", "again")[0] == 0
        (run,) = json.loads((tmp_path / "again" / "results.json").read_text())["runs"]
        assert (run["controller"], run["metrics"]["ripple_rad_s"]) == (controller, worst)


def test_variants_of_the_plant_meet_controllers_of_the_study(tmp_path: Path) -> None:
    """Gains by a rule stay those of the nominal motor; in a study with that inertia they would be others."""
    from cogless.design.speed_loop import gains
    from cogless.study import changed, for_scenario

    tuned = '[controller.rule]\nlaw = "pi"\ntuning = { rule = "phase-margin", phase_margin = "60 deg" }\n'
    study = ensembles.study(tmp_path, vary=tuned + ensembles.VARY)
    changes = draw(study, 4).changes(1)
    variant = changed(study, changes)
    inertia = for_scenario(variant, "low").mechanics.inertia
    assert inertia != study.mechanics.inertia == variant.mechanics.inertia
    assert gains(variant, "rule") == gains(study, "rule")
    assert gains(changed(study, {"mechanics.inertia": f"{inertia!r} kg*m^2"}), "rule") != gains(study, "rule")


def test_what_belongs_to_the_drive_varies_in_each_scenario(tmp_path: Path) -> None:
    """A controller is not told of it, and of a key of its own there is one for all scenarios."""
    vary = '[vary]\ndrive.current_loop.current_limit = { uniform = "10 %" }\n'
    vary += 'controller.pi.kp = { uniform = "10 %" }\n'
    assert set(draw(ensembles.study(tmp_path, vary=vary), 4).changes(1)) == {
        'scenario.low.override."drive.current_loop.current_limit"',
        "controller.pi.kp",
    }


def test_a_scenario_keeps_the_value_that_it_overrides_itself(tmp_path: Path) -> None:
    own = '[scenario.light]\nduration = "0.3 s"\nreference = "300 rpm"\n'
    own += 'override = { mechanics.inertia = "2e-4 kg*m^2" }\n'
    study = ensembles.study(tmp_path, vary=own + ensembles.VARY)
    changes = draw(study, 1).changes(0)
    assert [key for key in changes if "inertia" in key] == ['scenario.low.override."mechanics.inertia"']
    assert [key for key in changes if "friction" in key] == [
        'scenario.low.override."mechanics.viscous_friction"',
        'scenario.light.override."mechanics.viscous_friction"',
    ]
    assert all("scenario.light" in key for key in draw(study, 1).changes(0, "light"))


def test_a_plan_needs_no_workers(tmp_path: Path) -> None:
    planned = sweeping.plan(ensembles.study(tmp_path), 40)
    assert [len(planned.changes(chunk)) for chunk in range(planned.chunks)] == [16, 16, 8]
    assert [list(planned.part(sweeping.Shard(index, 2))) for index in (0, 1)] == [[0, 2], [1]]
    assert planned.variants(sweeping.Shard(0, 2)) == 24


@pytest.mark.parametrize(
    ("alone", "learned", "tone"),  # most of a variant's ripple, in limits
    [(4.0, 4.0, "worse"), (4.0, 0.9, "better"), (0.9, 4.0, "worse"), (0.9, 0.9, "even")],
)
def test_the_verdict_is_no_praise_where_the_limit_is_broken(
    tmp_path: Path, alone: float, learned: float, tone: str
) -> None:
    limit = ensembles.study(tmp_path).metric[0].limit
    assert limit is not None
    sweep = made(tmp_path, 100, lambda x, y: alone * limit * x)
    sweep.values[:, 1, 0] = sweep.values[:, 0, 0] * learned / alone
    report.write(sweep, tmp_path / "report.html", lambda settings, pair: "")
    assert f'<section class="answer {tone}"' in (tmp_path / "report.html").read_text()


def linear(folder: Path, **metric: Any) -> Sweep:
    """A hundred variants whose ripple is 0.04, 0.08, ... 4 rpm with the PI, and half of it with PI-ILC."""
    sweep = made(folder, 100, lambda x, y: (x + 0.01) * 4 * np.pi / 30)
    sweep.values[:, 1, 0] = sweep.values[:, 0, 0] / 2
    if not metric:
        return sweep
    ripple, *others = sweep.study.metric
    study = sweep.study.model_copy(update={"metric": (ripple.model_copy(update=metric), *others)})
    return replace(sweep, study=study, columns=columns(study))


def cells(text: str, kind: str) -> list[list[str]]:
    """The rows of the tables of a class, as texts."""
    tables = re.findall(rf'<table class="{kind}".*?</table>', text, re.DOTALL)
    rows = [row for table in tables for row in re.findall(r"<tr>(.*?)</tr>", table, re.DOTALL)]
    return [
        [unescape(re.sub(r"<[^>]+>", "", cell)) for cell in re.findall(r"<t[hd].*?</t[hd]>", row)]
        for row in rows
    ]


def test_the_answer_is_told_line_by_line(tmp_path: Path) -> None:
    """The limit is 3 rpm: 75 of the 100 keep it, and all of those halved; Wilson's intervals beside."""
    sweep = linear(tmp_path)
    worst = int(np.argmax(sweep.values[:, 0, 0]))
    all_keep = "low: Ripple keeps its limit in this share of 100 variants: pi-ilc 100 % and pi 75.0 %."
    of_pi = (
        "    pi: 75.0 % keep the limit (95 % confidence: 65.7 % to 82.5 %); half are at 2.00 rpm or better, "
        "95 % at "
        f"3.80 rpm; worst 4.00 rpm (variant {worst})"
    )
    rest = f"half are at 1.00 rpm or better, 95 % at 1.90 rpm; worst 2.00 rpm (variant {worst})"
    told = report.write(sweep, tmp_path / "report.html", lambda settings, pair: "")
    assert told[:3] == [all_keep, "  ripple, at most 3.00 rpm", of_pi] and len(told) == 4
    kept = "    pi-ilc: 100 % keep the limit (95 % confidence: 96.3 % to "
    assert told[3].startswith(kept) and told[3].endswith(rest)
    broken = replace(sweep, errors={(3, 0): "no", (4, 1): "no"})
    more = report.write(broken, tmp_path / "report.html", lambda settings, pair: "")
    assert more == [*told, "  2 runs failed; sweep.parquet has their errors."]


def test_a_variant_keeps_the_limits_if_it_keeps_all_of_them(tmp_path: Path) -> None:
    """The ripple's limit is broken from 3 rpm on, the order's from 1 to 2: half of the variants keep both."""
    sweep = linear(tmp_path)
    ripple, orders = sweep.study.metric
    study = sweep.study.model_copy(update={"metric": (ripple, orders.model_copy(update={"limit": 0.15}))})
    rpm = sweep.values[:, 0, 0] * 30 / np.pi
    sweep.values[(rpm > 1.01) & (rpm < 2.01), 0, 1] = 0.2
    both = replace(sweep, study=study, columns=columns(study))
    told = report.write(both, tmp_path / "report.html", lambda settings, pair: "")
    assert told[0] == "low: All limits are kept in this share of 100 variants: pi-ilc 100 % and pi 50.0 %."
    assert told[1::3] == [
        "  ripple, at most 3.00 rpm",
        "  speed: order 24, at most 0.150 rad/s",
        "  speed: order 48, at most 0.150 rad/s",
    ]


@pytest.mark.parametrize(("limit", "tone"), [(2.02, "even"), (1.98, "worse")])
def test_no_controller_is_praised_where_most_variants_break_the_limit(
    tmp_path: Path, limit: float, tone: str
) -> None:
    """Of 0.04, 0.08, ... 4 rpm half are below 2.02, and 49 of 100 below 1.98."""
    sweep = linear(tmp_path, limit=limit * np.pi / 30)
    sweep.values[:, 1, 0] = sweep.values[:, 0, 0]
    assert f'<section class="answer {tone}"' in page(sweep, tmp_path)


def test_parts_of_a_metric_are_named(tmp_path: Path) -> None:
    ripple, orders = ensembles.study(tmp_path).metric
    parts = [
        Column(ripple),
        Column(orders, 1, "48"),
        Column(ripple, 1, "2"),
        Column(ripple, None, LAST_TRIAL),
    ]
    names = ["ripple", "speed: order 48", "ripple: phase 2", "ripple: last trial"]
    assert [report._name(column) for column in parts] == names


def test_without_a_limit_the_spread_is_told_and_what_a_limit_would_tell(tmp_path: Path) -> None:
    sweep = linear(tmp_path, limit=None)
    first, heading, *_, last = report.write(sweep, tmp_path / "r.html", lambda settings, pair: "")
    assert first == "low: How 100 variants spread, by controller." and heading == "  ripple"
    assert last == (
        "  No metric has a limit. With limit = ... in a metric's table, this page shows the share of "
        "variants that keep it."
    )
    assert '<section class="answer even"' in (tmp_path / "r.html").read_text()


def test_where_more_is_better_the_low_end_is_the_worst(tmp_path: Path) -> None:
    """At least 3 rpm: of 0.04 to 4 rpm 26 of 100; half at 2.04 or better, 95 % at 0.24."""
    sweep = linear(tmp_path, better="higher")
    worst = int(np.argmin(sweep.values[:, 0, 0]))
    told = report.write(sweep, tmp_path / "report.html", lambda settings, pair: "")
    assert told[0].endswith("of 100 variants: pi 26.0 % and pi-ilc 0 %.")
    assert told[1] == "  ripple, at least 3.00 rpm"
    assert told[2].endswith(
        f"half are at 2.04 rpm or better, 95 % at 0.240 rpm; worst 0.0400 rpm (variant {worst})"
    )
    sweep.values[np.argsort(sweep.values[:, 0, 0])[1], 0, 0] = np.nan  # of 0.08 rpm
    text = page(sweep, tmp_path)
    data = json.loads(re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1])
    (chart,) = data["scenarios"][0]["spreads"]
    drawn = chart["series"][0]["values"]
    assert drawn[:-1] == pytest.approx([*(0.04 * np.arange(100, 2, -1)), 0.04], rel=1e-4)  # the best first
    assert drawn[-1] is None  # what has no value comes last


def test_tables_of_a_sweep(tmp_path: Path) -> None:
    sweep = linear(tmp_path)
    sweep.values[np.argmax(sweep.values[:, 1, 0]), 1, 0] = np.nan  # the worst has no value
    report.write(sweep, tmp_path / "report.html", lambda settings, pair: f"run {pair[1]} {len(settings)}")
    text = (tmp_path / "report.html").read_text()
    numbers = cells(text, "numbers")
    assert numbers[:7] == [
        ["", "pi", "pi-ilc"],
        ["ripple, at most 3.00 rpm", "", ""],
        ["share that keeps the limit", "75.0 %", "99.0 %"],
        ["median", "2.00 rpm", "1.00 rpm"],
        ["95 % of variants", "3.80 rpm", "1.90 rpm"],
        ["worst", "4.00 rpm", "never"],
        ["without a value", "0", "1"],
    ]
    assert ["ripple", "pi rank", "alone", "pi-ilc rank", "alone"] in numbers
    ranks = {row[0]: row[1:] for row in numbers if row[0].startswith("mechanics.")}
    assert ranks["mechanics.inertia"][:2] == ["1.00", "–"]  # noqa: RUF001 (too few variants for shares)
    assert cells(text, "worst") == [
        ["Metric", "Controller", "Worst", "Command that repeats it"],
        ["ripple", "pi", "4.00 rpm", "run pi 2"],
        ["ripple", "pi-ilc", "never", "run pi-ilc 2"],
    ]
    data = json.loads(re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1])
    (spread,) = data["scenarios"][0]["spreads"]
    assert (spread["title"], spread["unit"], spread["limit"]) == ("ripple: share of variants", "rpm", 3.0)
    assert spread["xs"][0] == 0 and spread["xs"][-1] == 100 and len(spread["xs"]) == 100
    pi, ilc = (series["values"] for series in spread["series"])
    assert pi == pytest.approx(list(0.04 * np.arange(1, 101)), rel=1e-4)
    assert ilc[-1] is None and ilc[-2] == pytest.approx(1.98)  # what has no value comes last


@pytest.mark.parametrize(
    ("share", "text"), [(0.0, "0 %"), (1.0, "100 %"), (1e-4, "0.1 %"), (0.99999, "99.9 %"), (0.123, "12.3 %")]
)
def test_a_share_is_all_or_nothing_only_if_it_is(share: float, text: str) -> None:
    assert report._percent(share) == text
