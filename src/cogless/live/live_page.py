"""The live page: one HTML file with the engine, which runs a study again whenever a value is changed."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import accumulate, pairwise
from string import Template
from typing import Any

from cogless.control_library import C_LAWS, Status
from cogless.design.unlearned import revolutions_learned
from cogless.files import package_folders, versions
from cogless.live import engine, own_motor
from cogless.live.description import Packed, Place, left_out, page_runs
from cogless.live.key_words import key_words
from cogless.live.keys import AdjustableKeys, Key, adjustable, packed
from cogless.live.motor_classes import motor_classes
from cogless.live.sensor_choices import SensorChoice, sensor_choices
from cogless.live.spare_orders import spare_orders
from cogless.report.markup import asset as report_asset
from cogless.report.phases import display_unit, groups, judged, phases
from cogless.report.speed_tracking import (
    STATE_TIME_LEAST,
)
from cogless.report.trials import panels_of
from cogless.results.held_speed import (
    JERKS_RATIO,
    LOST_SPEED_RATIO,
    MEAN_ERROR_MOST,
    ONE_WAY,
    REST_ERROR_MOST,
)
from cogless.results.metrics import result_name
from cogless.run.run_plan import NEVER_LEARNS
from cogless.study import AnyStudy, Study, TrialStudy, for_scenario
from cogless.study.base import Kind
from cogless.study.metric import CARRIAGE_ORDERS, EACH_TRIAL, SIGNAL_DIMENSIONS, Metric, whole_revolutions
from cogless.study.reading import Changes
from cogless.study.toml import sections, toml
from cogless.units import NONE, factor

NO_LIMITS: Mapping[str, str] = {}
NO_PINS: Changes = {}
COLOUR_COUNT = 8  # as many as in the report
FORBID = (
    "default-src 'none'; script-src {scripts} 'wasm-unsafe-eval'; style-src {styles}; worker-src blob:; "
    "base-uri 'none'; form-action 'none'"
)


def render(
    study: AnyStudy,
    command: str,
    for_own_motor: bool = False,
    limits: Mapping[str, str] = NO_LIMITS,
    pins: Changes = NO_PINS,
) -> str:
    """The page as one HTML text. `command`: the command that runs the study, without changes from the page.

    `pins`: values of the study that its file leaves to the design; a command that changes a controller must
    set these, too.

    `limits`: by scenario, what limits its best run, if that was looked for.
    `for_own_motor`: the motor's values are changed in the study itself, not in an override, so that the
    controllers know them.

    StudyError: no WebAssembly engine, or no run that a page can hold.
    """
    module = engine.module(study.precision)
    adjustable_keys = adjustable(study, for_own_motor)
    blocks = {
        "data": json.dumps(
            data(study, adjustable_keys, command, limits, pins), separators=(",", ":"), allow_nan=False
        ),
        "engine": base64.b64encode(gzip.compress(module, mtime=0)).decode(),
    }
    scripts = {
        "worker": asset("engine.js") + asset("metrics.js") + asset("worker.js"),
        "uplot_js": report_asset("uplot.min.js"),
        "js": asset("bytes.js") + asset("state.js") + asset("live.js"),
    }
    styles = {
        "uplot_css": report_asset("uplot.min.css"),
        "css": report_asset("report.css") + asset("live.css"),
    }
    policy = FORBID.format(
        scripts=_hashes([scripts["uplot_js"], scripts["js"]]), styles=_hashes(styles.values())
    )
    return Template(asset("live.html")).substitute(
        title=escape(study.title),
        description=_description(study),
        version=escape(versions()["cogless"]),
        policy=policy,
        left_out=_left_out(study, adjustable_keys),
        **{name: text.replace("<", "\\u003c") for name, text in blocks.items()},
        **scripts,
        **styles,
    )


def asset(name: str) -> str:
    """The text of a file in this folder's assets/."""
    for folder in package_folders():
        path = folder / "live" / "assets" / name
        if path.is_file():
            return path.read_text(encoding="utf-8")
    raise FileNotFoundError(name)


def _hashes(texts: Any) -> str:
    return " ".join(
        f"'sha256-{base64.b64encode(hashlib.sha256(t.encode()).digest()).decode()}'" for t in texts
    )


def data(
    study: AnyStudy,
    adjustable_keys: AdjustableKeys,
    command: str,
    limits: Mapping[str, str] = NO_LIMITS,
    pins: Changes = NO_PINS,
) -> dict[str, Any]:
    """All data that the page's scripts need, as plain values."""
    pairs = page_runs(study)
    page = PAGES[study.kind]
    spares, cogging = page.spare_orders(study, adjustable_keys.base)
    sensors = page.sensor_choices(study, adjustable_keys, spares)
    names = [name for name in study.controller if any(name == c for _, c in pairs)]
    others = [name for name in names if name != study.baseline]
    return {
        "command": command,
        "pins": [[key, f"{key}={toml(value)}"] for key, value in pins.items()],
        "name": study.name,
        "toml": sections(study.source),
        "kind": study.kind,
        "busy": int(Status.BUSY),
        "guarded": int(Status.GUARDED),
        "moment": STATE_TIME_LEAST,
        "tracking": {
            "far": MEAN_ERROR_MOST,
            "jerks": JERKS_RATIO,
            "lost": LOST_SPEED_RATIO,
            "drift": REST_ERROR_MOST,
            "one_way": ONE_WAY,
        },
        "scenarios": [
            {
                "name": scenario,
                "controllers": [c for s, c in pairs if s == scenario],
                "metrics": [_metric(study, scenario, metric) for metric in study.metrics_in(scenario)],
                "limit": limits.get(scenario, ""),
                **PAGES[study.kind].scenario(study, scenario),
            }
            for scenario in dict.fromkeys(scenario for scenario, _ in pairs)
        ],
        "controllers": [
            {
                "name": name,
                "label": study.label(name),
                "colour": 0 if name == study.baseline else 1 + others.index(name) % (COLOUR_COUNT - 1),
                "learns": _learns(study, name),
                "baseline": name == study.baseline,
                "by_order": _by_order(study.controller[name].law),
                "turn": PAGES[study.kind].turn(study, name),
            }
            for name in names
        ],
        "keys": [_with_sensors(_key(study, key), key, sensors) for key in (*adjustable_keys.keys, *spares)],
        "sensors": [{"words": sensor.words, "text": sensor.text} for sensor in sensors],
        "cogging": cogging,
        "classes": motor_classes(adjustable_keys.keys) if adjustable_keys.own_motor is not None else [],
        "motor": _motor(study, adjustable_keys),
        "runs": {"/".join(place): _run(blob) for place, blob in packed(study, pairs).items()}
        | {
            f"{n}|{'/'.join(place)}": _run(blob)
            for n, sensor in enumerate(sensors, 1)
            for place, blob in sensor.runs.items()
        },
    }


def _learns(study: AnyStudy, name: str) -> bool:
    law = study.controller[name]
    return law.learns or law.learns_from_trials


def _by_order(law: str) -> bool:
    return law in C_LAWS and C_LAWS[law].by_order


def _turn(study: Study, name: str) -> float:
    return float(revolutions_learned(study, name) or 1)


def _speed_scenario(study: Study, scenario: str) -> dict[str, Any]:
    torque, end = study.scenario[scenario].torque_mode, study.scenario[scenario].duration
    return {
        "rate": for_scenario(study, scenario).drive.rates.current_loop,
        "torque": [torque.time, min(torque.end, end)] if torque is not None else None,
    }


def _trial_scenario(study: TrialStudy, scenario: str) -> dict[str, Any]:
    metric_words = judged(study, scenario)
    return {
        "judged": {
            "signal": metric_words.signal,
            "quantity": metric_words.quantity,
            "unit": metric_words.unit,
            "factor": metric_words.scale,
            "floor": metric_words.floor,
        },
        "phases": [
            {"name": phase.name, "trials": phase.chosen}
            for group in groups(phases(study.scenario[scenario]))
            for phase in group.drawn
        ],
        "panels": [
            dict(
                zip(
                    ("title", "signal", "reference", "quantity", "unit", "factor"),
                    (*panel, *unit),
                    strict=True,
                )
            )
            for panel in panels_of(study, scenario)
            for unit in [display_unit(study, panel[1])]
        ],
    }


def _carriage(study: AnyStudy, scenario: str, metric: Metric) -> dict[str, Any]:
    """What a metric of a carriage needs besides a trace."""
    if metric.kind != "carriage-ripple":
        return {}
    return {"radius": study.conditions(scenario).carriage_radius, "carriage_orders": CARRIAGE_ORDERS}


def _metric(study: AnyStudy, scenario: str, metric: Metric) -> dict[str, Any]:
    dimension = metric.dimension
    unit = metric.unit or dimension.unit
    orders = metric.order or (None,)
    words = metric.name.replace("_", " ")
    titles = [words if order is None else f"{words} {order:g}" for order in orders]
    rows = PAGES[study.kind].values(study, scenario, metric)
    if rows is not None:
        titles = [f"{words}, {name}" for name, _ in rows]
    return {
        "name": result_name(metric),
        "titles": titles,
        # for each title: its first phase, and the phase after its last; null: one value per title
        "groups": None if rows is None else [group for _, group in rows],
        "unit": unit,
        "factor": factor(unit, dimension) if dimension is not NONE and unit else 1.0,
        "kind": metric.kind,
        "signal": metric.signal,
        "signal_unit": SIGNAL_DIMENSIONS[metric.signal].unit if metric.signal else "",
        "units": {name: SIGNAL_DIMENSIONS[name].unit for name in ("omega_ref", "i_d_ref", "i_q_ref")},
        "order": metric.order,
        "revolutions": whole_revolutions(metric.order or ()),  # number with whole periods of every order
        "frame": metric.frame,
        **_carriage(study, scenario, metric),
        "window": metric.window,
        "last": metric.last,
        "event": metric.event,
        "band": metric.band,
        "smooth": metric.smooth,
        "floor": metric.floor,
        "better": metric.better_direction,
    }


def _phases_listed(study: TrialStudy, scenario: str, metric: Metric) -> list[tuple[str, tuple[int, int]]]:
    """The name of each group of phases, with the group's first phase and the phase after its last.

    Empty for a metric with a number for each trial: the page draws these numbers.
    """
    listed = [] if metric.kind in EACH_TRIAL else groups(phases(study.scenario[scenario]))
    ends = accumulate((len(group.phases) for group in listed), initial=0)
    return list(zip((group.row for group in listed), pairwise(ends), strict=True))


@dataclass(frozen=True)
class KindOfPage:
    """What a page needs to know about a kind of study."""

    scenario: Callable[[Any, str], dict[str, Any]]  # a scenario's data besides controllers and metrics
    turn: Callable[[Any, str], float]  # mechanical revolutions that a controller's learned map spans
    # a metric's titles, each with its first phase and the one after its last; None: a value, or one per order
    values: Callable[[Any, str, Metric], list[tuple[str, tuple[int, int]]] | None]
    # keys of the cogging orders that can be added, and the orders that the study has
    spare_orders: Callable[[Any, Mapping[Place, Packed]], tuple[list[Key], dict[str, Any]]]
    sensor_choices: Callable[
        [Any, AdjustableKeys, list[Key]], Sequence[Any]
    ]  # position sensors that can be chosen instead


PAGES: Mapping[Kind, KindOfPage] = {
    "speed": KindOfPage(
        scenario=_speed_scenario,
        turn=_turn,
        values=lambda study, scenario, metric: None,
        spare_orders=spare_orders,
        sensor_choices=sensor_choices,
    ),
    "trials": KindOfPage(
        scenario=_trial_scenario,
        turn=lambda study, name: 1.0,
        values=_phases_listed,
        spare_orders=lambda study, base: ([], {}),
        sensor_choices=lambda study, page_keys, spares: [],
    ),
}


def _run(blob: Packed) -> dict[str, Any]:
    """A packed description, and the places of the numbers in it that the page reads."""
    places = {n.path: [n.offset, n.format] for n in blob.numbers}
    page_places = {
        path: at for path, at in places.items() if path.startswith("page.") and ".learned." not in path
    }
    shape = next((shape.split()[1] for shape in blob.shape if shape.startswith("page.learned ")), None)
    return {
        "bytes": base64.b64encode(blob.data).decode(),
        "about": page_places,
        "off": _off(places),
        "learned": shape and [places["page.learned.0"][0], *map(int, shape.split("x"))],
    }


def _off(places: dict[str, list[Any]]) -> list[Any] | None:
    """Offset, format and value of a number that keeps a law from learning; None if there is none."""
    for path, value in (("controller.learning_start", NEVER_LEARNS), ("controller.config.k_3", 0.0)):
        if path in places:
            return [*places[path], value]
    return None


def _key(study: AnyStudy, key: Key) -> dict[str, Any]:
    candidate = key.candidate
    return {
        "key": candidate.key,
        "label": candidate.label,
        "words": key_words(study, candidate.label),
        "group": candidate.group,
        "scenario": candidate.scenario,
        "controller": candidate.controller,
        "unit": candidate.unit,
        "factor": candidate.factor,
        "start": candidate.start,
        "low": candidate.low,
        "high": candidate.high,
        "least": candidate.least,
        "most": candidate.most,
        "whole": candidate.whole,
        "stops": key.stops,
        "lands": {_place(place): [_landing(key, one) for one in lands] for place, lands in key.lands.items()},
    }


def _with_sensors(packed_key: dict[str, Any], key: Key, sensors: Sequence[SensorChoice]) -> dict[str, Any]:
    """The key, also with the numbers that it sets with other sensors, at places that begin with "SENSOR|"."""
    for n, sensor in enumerate(sensors, 1):
        for place, lands in sensor.lands.get(key.candidate.key, {}).items():
            packed_key["lands"][f"{n}|{_place(place)}"] = [_landing(key, one) for one in lands]
    return packed_key


def _place(place: Place) -> str:
    return "/".join(place)


def _landing(key: Key, one: Any) -> list[Any]:
    if key.stops:
        return [one.number.offset, one.number.format, list(one.by_pairs or one.values)]
    return [one.number.offset, one.number.format, one.scale, one.rounded]


def _motor(study: AnyStudy, adjustable_keys: AdjustableKeys) -> dict[str, Any] | None:
    """What a page needs to set the numbers that depend on one's own motor; None without one."""
    own = adjustable_keys.own_motor
    if own is None:
        return None
    assert study.motor is not None
    plant = study.motor.star()
    return {
        "over": own_motor.RESISTANCE_KEY,
        "under": own_motor.INDUCTANCE_KEY,
        "pole_pairs": own_motor.POLE_PAIRS,
        "nodes": own_motor.nodes(own.ends),
        "ends": own.ends,
        "time": plant.L_d / plant.R_s,
        "products": {_place(place): list(map(_product, all_of)) for place, all_of in own.products.items()},
    }


def _product(one: own_motor.Product) -> list[Any]:
    return [one.number.offset, one.number.format, one.start, dict(one.powers), one.factors, one.curve]


def _description(study: AnyStudy) -> str:
    if not study.description:
        return ""
    text = escape(study.description)
    return f'<section><h2>About this study</h2><p class="description">{text}</p></section>'


def _left_out(study: AnyStudy, adjustable_keys: AdjustableKeys) -> str:
    lines = left_out(study)
    lines += [f"{key}: {why}." for key, why in adjustable_keys.left_out]
    if not lines:
        return ""
    rows = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<details><summary>Keys that the page can't change</summary><ul>{rows}</ul></details>"
