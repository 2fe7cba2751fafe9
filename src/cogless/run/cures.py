"""What may help against a cause: changes of a study, each to be tried before it is told."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from cogless.results import Run
from cogless.run.causes import CURRENTS, INVERTER, LOOP, SENSOR, longer
from cogless.study import Study, for_scenario
from cogless.study.controller import Feedback, Learning
from cogless.study.drive import CurrentLoop
from cogless.study.harmonic import Harmonic
from cogless.study.metric import Metric
from cogless.study.position_sensor import Absolute, Counted, Encoder, Hall, Resolver
from cogless.study.reading import Changes

OCTAVES = (4, 8, 16, 32)  # an observer's bandwidth is the law's rate over one of these
FAST_OCTAVES = (1, 2, 4)  # the same where it shall be quick
FACTORS = (2, 4)
MORE_BITS = (2, 6)
HALL_EDGES = (6, 3, 1)  # intervals that the speed is taken over
BANDS = (0.003, 0.01, 0.03)  # of the current limit, in which dead time is compensated in part


@dataclass(frozen=True)
class Candidate:
    """A change that may help. `setting`: it needs no other part, only another number."""

    changes: Changes
    setting: bool = True


def candidates(study: Study, run: Run, metric: Metric, cause: str) -> list[Candidate]:
    """Changes that may help against a cause; some may be refused, and some may not help."""
    here = for_scenario(study, run.scenario)
    rules: dict[str, Callable[[], Iterable[Candidate]]] = {
        "sensor-steps": lambda: [*_observers(here), *_hall_edges(here), *_finer(here)],
        "sensor-error": lambda: [*_encoder_tables(here, run.scenario), *_hall_edges(here)],
        "delay": lambda: [
            *_observers(here, FAST_OCTAVES),
            *_rates(here),
            *_quicker(here),
            *_hall_edges(here),
        ],
        "dead-time": lambda: _compensations(here),
        "current-noise": lambda: _calmer(here),
        "learning-time": lambda: [Candidate(longer(study, run.scenario, run.controller, metric))],
        "disturbance": lambda: [*_laws(here, run.controller), *_rates(here), *_gains(here, run.controller)],
        "limit": lambda: _limits(here),
    }
    return [c for c in (rules[cause]() if cause in rules else ()) if c.changes]


def _observers(study: Study, octaves: Sequence[int] = OCTAVES) -> Iterator[Candidate]:
    """An observer for the speed, or one of another bandwidth."""
    sensor, rates = study.drive.position_sensor, study.drive.rates
    if not isinstance(sensor, Counted):
        return
    for octave in octaves:
        bandwidth = _round(rates.outer_loop / octave)
        if bandwidth > rates.current_loop / math.pi:
            continue
        of_observer = {"speed_method": "observer", "observer_bandwidth": f"{bandwidth:g} Hz"}
        table = study.source.tables["drive"]["position_sensor"]
        if "window" in table:  # only an average may have one
            yield Candidate({SENSOR: {**{k: v for k, v in table.items() if k != "window"}, **of_observer}})
        else:
            yield Candidate({f"{SENSOR}.{key}": value for key, value in of_observer.items()})


def _finer(study: Study) -> Iterator[Candidate]:
    sensor = study.drive.position_sensor
    for more in MORE_BITS:
        if isinstance(sensor, Encoder):
            yield Candidate({f"{SENSOR}.lines": sensor.lines << more}, setting=False)
        elif isinstance(sensor, Absolute | Resolver):
            bits = getattr(sensor, "bits", None)
            fine = {f"{SENSOR}.bits": bits + more} if bits else {f"{SENSOR}.positions": sensor.counts << more}
            yield Candidate(fine, setting=False)


def _hall_edges(study: Study) -> Iterator[Candidate]:
    """The speed of Hall sensors over other numbers of edges: all six, whose errors of placement cancel, or
    fewer, which is younger."""
    sensor = study.drive.position_sensor
    if isinstance(sensor, Hall):
        for edges in HALL_EDGES:
            if edges != sensor.edges:
                yield Candidate({f"{SENSOR}.edges": edges})


def _encoder_tables(study: Study, scenario: str) -> Iterator[Candidate]:
    """A table of the sensor's error, of its largest orders, learned at the scenario's own speed."""
    sensor, slowest = study.drive.position_sensor, study.scenario[scenario].slowest
    if not isinstance(sensor, Counted) or study.drive.encoder_table is not None or not slowest:
        return
    sizes = {n: abs(sensor.wave(n)) for n in range(1, 65)}
    largest = sorted(sizes, key=lambda n: -sizes[n])[:4]
    orders = sorted(n for n in largest if sizes[n] > 0.1 * sizes[largest[0]])
    yield Candidate({"drive.encoder_table": {"orders": orders, "omega_min": f"{slowest / 2:.4g} rad/s"}})


def _rates(study: Study) -> Iterator[Candidate]:
    """The law twice as often, and as often as it can run."""
    rates = study.drive.rates
    for factor in dict.fromkeys((2, rates.divider)):
        if rates.divider % factor == 0 and factor > 1:
            yield Candidate({"drive.rates.speed_loop": f"{rates.outer_loop * factor / 1000:g} kHz"})


def _quicker(study: Study) -> Iterator[Candidate]:
    """A shorter window for the speed, or a higher filter."""
    drive, sensor = study.drive, study.drive.position_sensor
    if isinstance(sensor, Counted) and sensor.speed_method == "average":
        for factor in FACTORS:
            if sensor.window >= factor:
                yield Candidate({f"{SENSOR}.window": sensor.window // factor})
    if drive.speed_filter is not None:
        yield Candidate({"drive.speed_filter": f"{_round(4 * drive.speed_filter):g} Hz"})


def _compensations(study: Study) -> Iterator[Candidate]:
    drive, key = study.drive, "drive.dead_time_compensation"
    for share in BANDS:
        band = f"{1000 * _round(share * drive.current_loop.current_limit):g} mA"
        yield Candidate({f"{key}.band": band} if drive.dead_time_compensation else {key: {"band": band}})


def _calmer(study: Study) -> Iterator[Candidate]:
    """A slower current loop, whose output has less of the noise; then better sensors."""
    loop, sensors = study.drive.current_loop, study.drive.current_sensors
    for factor in FACTORS:
        if isinstance(loop, CurrentLoop) and loop.bandwidth is not None:
            yield Candidate({f"{LOOP}.bandwidth": f"{_round(loop.bandwidth / factor):g} Hz"})
        elif isinstance(loop, CurrentLoop) and loop.kp is not None and loop.ki is not None:
            slower = {f"{LOOP}.kp": f"{loop.kp / factor:.4g} V/A"}
            yield Candidate({**slower, f"{LOOP}.ki": f"{loop.ki / factor:.4g} V/A/s"})
    if sensors.noise:
        yield Candidate({f"{CURRENTS}.noise": f"{1000 * sensors.noise / 4:.4g} mA"}, setting=False)
    if sensors.bits:
        yield Candidate({f"{CURRENTS}.bits": min(32, sensors.bits + 4)}, setting=False)


def _laws(study: Study, controller: str) -> Iterator[Candidate]:
    """The law that learns all orders, with the same feedback where that is a PI."""
    law = study.controller[controller]
    if isinstance(law, Harmonic) or not isinstance(law, Feedback):
        return
    table = study.source.tables["controller"][controller]
    same = {key: table[key] for key in ("kp", "ki", "tuning", "baseline") if key in table}
    yield Candidate({f'controller."{controller}"': {"law": "harmonic", **same}})


def _gains(study: Study, controller: str) -> Iterator[Candidate]:
    law = study.controller[controller]
    key = f'controller."{controller}"'
    if isinstance(law, Feedback) and law.kp is not None and law.ki is not None:
        faster = {f"{key}.kp": f"{2 * law.kp:.4g} A*s/rad", f"{key}.ki": f"{2 * law.ki:.4g} A/rad"}
        yield Candidate(faster)
    if isinstance(law, Learning) and law.q_half_width:
        yield Candidate({f"{key}.q_half_width": law.q_half_width // 2})


def _limits(study: Study) -> Iterator[Candidate]:
    drive = study.drive
    yield Candidate({f"{LOOP}.current_limit": f"{_round(2 * drive.current_loop.current_limit):g} A"})
    if drive.inverter is not None:
        more = f"{_round(2 * drive.inverter.bus_voltage):g} V"
        yield Candidate({f"{INVERTER}.bus_voltage": more}, setting=False)


def _round(value: float) -> float:
    """The value with two digits, as one would write it."""
    return float(f"{value:.2g}")
