"""The position sensor of a study, and the method that suits it for measuring the speed.

Hall sensors              the time over six edges, in which the errors of their places cancel
incremental, timed edges  counts over the time between edges (MT), where the drive can time them
all others                an observer of the angle, three times as fast as the loop's crossover, and no
                          faster than counts come (docs/theory/sensors.md): `fit_observer`
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from cogless import units
from cogless.design.closed_loop import Linear, position_margins
from cogless.design.law_rules import feedback_of
from cogless.design.speed_loop import speed_loop
from cogless.design.warnings import slow_warning
from cogless.errors import StudyError
from cogless.starter.amounts import amount, exact_rate, span
from cogless.starter.part_catalogue import Part
from cogless.starter.request import Request
from cogless.starter.sheet import Guess, Section, Sheet, origin
from cogless.study import Study, changed
from cogless.study.position_sensor import Counted

HALL_EDGES_PER_SECOND = 150.0  # 1/s, least at the chosen speed
COUNTS_PER_SECOND = 500.0  # 1/s, least at the chosen speed, of an encoder
HALL_PATTERN = (1.0, -1.5, 0.5, 1.5, -1.0, -0.5)  # misplacement of each edge / the typical one; sum zero
PATH = "drive.position_sensor"
CROSSOVER_TIMES = 3.0  # bandwidth of an observer over the crossover: docs/theory/sensors.md
OBSERVER_ROUNDS = 6  # rounds of the search for a bandwidth
FIRST_SHARE = 1 / 20  # bandwidth at which the search begins / rate of the speed loop
SLOWEST_OBSERVER = 2.0  # Hz, bandwidth that is allowed even where counts come slowly
BY_RULE = "three times the speed loop's crossover, or less if counts come too rarely"
TRIED = "chosen by runs: with this value harmonic leaves less ripple"
UNFITTED_BANDWIDTH = "100 Hz"  # bandwidth in the study that fit_observer is given


def sensor_counts(request: Request, sensor: Part) -> int:
    """The steps of an encoder in a revolution."""
    if sensor.table["kind"] == "encoder":
        return int(request.value("cpr") or sensor["counts"].typical)
    return int(2 ** (request.value("bits") or sensor["bits"].typical))


def put_sensor(
    sheet: Sheet,
    request: Request,
    sensor: Part,
    drive: Part,
    *,
    observer: Mapping[str, str],
    tried: Mapping[str, str],
) -> None:
    """Write the sensor's section. `observer`: keys by `fit_observer`. `tried`: keys by runs."""
    section = sheet.section(f"[{PATH}]")
    kind = sensor.table["kind"]
    section.put("kind", kind, note=sensor.description)
    if kind == "hall":
        _hall(sheet, section, sensor)
        return
    if kind == "encoder":
        stated = "cpr" in request.numbers
        section.put(
            "lines", sensor_counts(request, sensor) // 4, *(() if stated else (origin(sensor["counts"]),))
        )
        if not stated:
            sheet.answers["cpr"] = str(sensor_counts(request, sensor))
    else:
        stated = "bits" in request.numbers
        bits = int(request.value("bits") or sensor["bits"].typical)
        section.put("bits", bits, *(() if stated else (origin(sensor["bits"]),)))
    own = f"{drive.name} itself: {drive.table['own_speed']}"
    timed = kind == "encoder" and "timer" in drive.figures
    method = tried or observer
    if timed and method.get("speed_method", "MT") == "MT":
        section.put("speed_method", "MT", own, note=TRIED if tried else "")
        section.put("timer", exact_rate(drive["timer"].typical), origin(drive["timer"]))
    else:
        section.put("speed_method", "observer", own)
        bandwidth = method.get("observer_bandwidth", UNFITTED_BANDWIDTH)
        section.put("observer_bandwidth", bandwidth, note=TRIED if tried else BY_RULE)
    if not timed and "latency" in sensor.figures:
        sheet.guess(
            section, "latency", sensor["latency"], units.TIME, path=PATH, name="age of the measured angle"
        )
    for place, key in enumerate(("once", "twice")):
        part = sheet.section(f"[[{PATH}.error]]")
        part.put("order", place + 1)
        sheet.guess(
            part,
            "amplitude",
            sensor[key],
            units.ANGLE,
            path=f"{PATH}.error.{place}",
            name=f"error of the sensor, {key} a turn",
        )
        if place:
            part.put("phase", "60 deg", note="arbitrary")


def reading_doubt(request: Request, sensor: Part, current_rate: float) -> list[str]:
    """A sentence, if a reading takes longer than a period of the current loop, and nobody stated its rate."""
    if "reading" not in sensor.figures or "current-rate" in request.numbers:
        return []
    reading = sensor["reading"].typical
    if current_rate * reading <= 1:
        return []
    fastest = exact_rate(1000 * (1 / reading // 1000))
    return [
        f"{request.encoder}: a reading takes {amount(reading, units.TIME)}, but the study assumes a new "
        f"angle in each period of a current loop at {exact_rate(current_rate)}; if your drive reads the "
        f"angle in each period, give --current-rate {fastest} or less"
    ]


def _hall(sheet: Sheet, section: Section, sensor: Part) -> None:
    figure = sensor["placement"]
    text = span(figure.low, figure.high, units.ANGLE)
    section.put("placement", _placement(figure.typical), f"guess: {text}; {figure.reason}")
    section.put("edges", 6, note="those of an electrical revolution, over which the placement errors cancel")
    variants = {
        amount(end, units.ANGLE): {f"{PATH}.placement": _placement(end)} for end in (figure.low, figure.high)
    }
    sheet.guesses.append(
        Guess(
            key=f"{PATH}.placement", name="placement errors of the Hall sensors", span=text, variants=variants
        )
    )


def _placement(size: float) -> list[str]:
    """The electrical angles by which the six edges come late, as text."""
    return [amount(size * share, units.ANGLE) for share in HALL_PATTERN]


def fit_observer(study: Study) -> dict[str, str]:
    """Changes of the study's sensor that choose its speed method; {} if the study has the right method.

    An observer's bandwidth is three times the crossover of the study's fastest controller, computed with this
    observer. The bandwidth is at most three times the rate of counts: beyond, the rotor coasts from count to
    count. An observer replaces timed edges that come too rarely.
    """
    sensor = study.drive.position_sensor
    if not isinstance(sensor, Counted):
        return {}
    if sensor.timed and not any(slow_warning(study, name) for name in study.controller):
        return {}
    counts = study.scenario[next(iter(study.scenario))].slowest / sensor.step  # 1/s
    most = max(SLOWEST_OBSERVER, CROSSOVER_TIMES * counts / math.tau)
    bandwidth = min(most, FIRST_SHARE * study.drive.rates.outer_loop)
    table = study.source.tables["drive"]["position_sensor"]
    others = {key: value for key, value in table.items() if key != "timer"}
    for _ in range(OBSERVER_ROUNDS):
        observed = changed(study, {PATH: {**others, **_observer(bandwidth)}})
        crossovers = [_crossover(observed, name) for name in observed.controller]
        if all(crossovers):
            bandwidth = min(most, CROSSOVER_TIMES * max(crossovers) / math.tau)
        else:  # with so slow an observer, no gains reach the margin that the rule asks for
            bandwidth, most = 2 * bandwidth, max(most, 2 * bandwidth)
    return _observer(bandwidth)


def _observer(bandwidth: float) -> dict[str, str]:
    return {"speed_method": "observer", "observer_bandwidth": _bandwidth_text(bandwidth)}


def _bandwidth_text(bandwidth: float) -> str:
    return f"{float(f'{bandwidth:.2g}'):g} Hz"


def _crossover(study: Study, name: str) -> float:
    """Crossover of a controller's feedback, rad/s; 0 if it has none."""
    try:
        feedback: Linear | None = feedback_of(study, name, 0.0)
    except StudyError:
        return 0.0
    if feedback is None:
        return 0.0
    crossover = position_margins(speed_loop(study), feedback).crossover
    return crossover if math.isfinite(crossover) else 0.0
