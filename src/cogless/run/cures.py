"""Changes of a study that may help against a cause. Each is tried in a run before it is advised."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from cogless.catalogue import sensor_bits
from cogless.design.gentler import timed_edges
from cogless.results import Run
from cogless.run.suspects import CURRENTS, INVERTER, LOOP, SENSOR, later, longer
from cogless.study import Study, for_scenario
from cogless.study.drive import CurrentLoop, EncoderTable
from cogless.study.metric import Metric
from cogless.study.position_sensor import Absolute, Counted, Encoder, Hall, Resolver
from cogless.study.reading import Changes

OCTAVES = (4, 8, 16, 32)  # law's rate / observer's bandwidth
FAST_OCTAVES = (1, 2, 4)  # law's rate / observer's bandwidth, against a cause that a faster observer lessens
TRIED_FACTORS = (2, 4)  # divisors of a speed window, or of a current loop's bandwidth or gains
MORE_BITS = (2, 6)  # bits by which a finer sensor's resolution is higher
HALL_EDGES = (6, 3, 1)  # intervals between edges over which the speed is taken
BANDS = (0.003, 0.01, 0.03)  # share of the current limit, below which dead time is compensated in part
CALIBRATED_SHARE = 0.1  # share of the current sensors' offsets and gain errors that calibration leaves
LEARNED_TIMES = 6  # time constants in which a table of the sensor's error is learned


@dataclass(frozen=True)
class Candidate:
    """A change that may help. `setting`: whether only a setting changes, and no part of the drive."""

    changes: Changes
    setting: bool = True


def candidates(study: Study, run: Run, metric: Metric, cause: str) -> list[Candidate]:
    """Changes that may help against a cause. The study may refuse some of them, and some may not help."""
    own_study = for_scenario(study, run.scenario)
    rules: dict[str, Callable[[], Iterable[Candidate]]] = {
        "sensor-steps": lambda: [
            *observers(own_study),
            *_timed(own_study),
            *_hall_edges(own_study),
            *_finer(own_study),
        ],
        "sensor-error": lambda: [*_encoder_tables(study, run, metric), *_hall_edges(own_study)],
        "delay": lambda: [
            *observers(own_study, FAST_OCTAVES),
            *rates_of_law(own_study),
            *_quicker(own_study),
            *_hall_edges(own_study),
        ],
        "dead-time": lambda: compensations(own_study),
        "current-noise": lambda: _calmer(own_study),
        "current-error": lambda: [*_calibrated(own_study), *_laws(own_study, run.controller)],
        "learning-time": lambda: [Candidate(longer(study, run.scenario, run.controller, metric))],
        "disturbance": lambda: [
            *_laws(own_study, run.controller),
            *rates_of_law(own_study),
            *_gains(own_study, run.controller),
        ],
        "limit": lambda: _limits(own_study),
    }
    return [c for c in (rules[cause]() if cause in rules else ()) if c.changes]


def observers(study: Study, octaves: Sequence[int] = OCTAVES) -> Iterator[Candidate]:
    """Candidates with an observer for the speed, of several bandwidths."""
    sensor, rates = study.drive.position_sensor, study.drive.rates
    if not isinstance(sensor, Counted):
        return
    for octave in octaves:
        bandwidth = _round(rates.outer_loop / octave)
        if bandwidth > rates.current_loop / math.pi:
            continue
        of_observer = {"speed_method": "observer", "observer_bandwidth": f"{bandwidth:g} Hz"}
        table = study.source.tables["drive"]["position_sensor"]
        if "window" in table:  # only the speed method "average" may have this key
            yield Candidate({SENSOR: {**{k: v for k, v in table.items() if k != "window"}, **of_observer}})
        else:
            yield Candidate({f"{SENSOR}.{key}": value for key, value in of_observer.items()})


def _finer(study: Study) -> Iterator[Candidate]:
    """Candidates with a finer sensor.

    An absolute encoder becomes the finest chip of the catalogue if this has two bits more or better. Any
    other sensor gets more lines, bits or positions.
    """
    sensor = study.drive.position_sensor
    bits, finest = getattr(sensor, "bits", None), max(sensor_bits().values())
    if isinstance(sensor, Absolute) and bits and bits + MORE_BITS[0] <= finest:
        yield Candidate({f"{SENSOR}.bits": finest}, setting=False)
        return
    for more in MORE_BITS:
        if isinstance(sensor, Encoder):
            yield Candidate({f"{SENSOR}.lines": sensor.lines << more}, setting=False)
        elif isinstance(sensor, Absolute | Resolver):
            fine = {f"{SENSOR}.bits": bits + more} if bits else {f"{SENSOR}.positions": sensor.counts << more}
            yield Candidate(fine, setting=False)


def _timed(study: Study) -> Iterator[Candidate]:
    """A candidate that takes the speed from the time between an encoder's edges; none for other sensors."""
    timed = timed_edges(study)
    if timed:
        yield Candidate(timed)


def _hall_edges(study: Study) -> Iterator[Candidate]:
    """Candidates that take the speed from Hall sensors over another number of edges.

    Over all six edges the errors of placement cancel. Over fewer edges the speed has less delay.
    """
    sensor = study.drive.position_sensor
    if isinstance(sensor, Hall):
        for edges in HALL_EDGES:
            if edges != sensor.edges:
                yield Candidate({f"{SENSOR}.edges": edges})


def _encoder_tables(study: Study, run: Run, metric: Metric) -> Iterator[Candidate]:
    """A candidate with a table of the sensor's largest errors, learned at the scenario's speed.

    If the run is too short to learn the table, it is also made longer, unless its law learns.
    """
    drive, experiment = for_scenario(study, run.scenario).drive, study.scenario[run.scenario]
    sensor, slowest = drive.position_sensor, experiment.slowest
    if not isinstance(sensor, Counted) or drive.encoder_table is not None or not slowest:
        return
    sizes = {n: abs(sensor.wave(n)) for n in range(1, 65)}
    largest = sorted(sizes, key=lambda n: -sizes[n])[:4]
    orders = sorted(n for n in largest if sizes[n] > 0.1 * sizes[largest[0]])
    keys = {"orders": orders, "omega_min": f"{slowest / 2:.4g} rad/s"}
    table, changes = EncoderTable.model_validate(keys), {"drive.encoder_table": keys}
    learned = table.settling + LEARNED_TIMES * table.time_constant
    begin, _ = metric.span(experiment.duration) or (0.0, 0.0)
    if learned > begin and not study.controller[run.controller].learns_while_running:
        changes |= later(study, run.scenario, metric, math.ceil(learned - begin))
    yield Candidate(changes)


def _calibrated(study: Study) -> Iterator[Candidate]:
    """A candidate with small offsets and gain errors, as after firmware has measured and corrected them."""
    sensors = study.drive.current_sensors
    less = {
        f"{CURRENTS}.offset": [f"{1000 * CALIBRATED_SHARE * error:.4g} mA" for error in sensors.offset],
        f"{CURRENTS}.gain_error": [float(f"{CALIBRATED_SHARE * error:.4g}") for error in sensors.gain_error],
    }
    yield Candidate({key: value for key, value in less.items() if any(getattr(sensors, key.split(".")[-1]))})


def rates_of_law(study: Study) -> Iterator[Candidate]:
    """Candidates with twice the rate of the law, and with the rate of the current loop."""
    rates = study.drive.rates
    for factor in dict.fromkeys((2, rates.divider)):
        if rates.divider % factor == 0 and factor > 1:
            yield Candidate({"drive.rates.speed_loop": f"{rates.outer_loop * factor / 1000:g} kHz"})


def _quicker(study: Study) -> Iterator[Candidate]:
    """Candidates with a shorter window for the speed, or a filter of higher frequency."""
    drive, sensor = study.drive, study.drive.position_sensor
    if isinstance(sensor, Counted) and sensor.speed_method == "average":
        for factor in TRIED_FACTORS:
            if sensor.window >= factor:
                yield Candidate({f"{SENSOR}.window": sensor.window // factor})
    if drive.speed_filter is not None:
        yield Candidate({"drive.speed_filter": f"{_round(4 * drive.speed_filter):g} Hz"})


def compensations(study: Study) -> Iterator[Candidate]:
    """Candidates that compensate dead time, each with another `band`."""
    drive, key = study.drive, "drive.dead_time_compensation"
    for share in BANDS:
        band = f"{1000 * _round(share * drive.current_loop.current_limit):g} mA"
        yield Candidate({f"{key}.band": band} if drive.dead_time_compensation else {key: {"band": band}})


def _calmer(study: Study) -> Iterator[Candidate]:
    """Candidates with a slower current loop, which amplifies less noise; then with better current sensors."""
    sensors = study.drive.current_sensors
    yield from slower_current_loops(study)
    if sensors.noise:
        yield Candidate({f"{CURRENTS}.noise": f"{1000 * sensors.noise / 4:.4g} mA"}, setting=False)
    if sensors.bits:
        yield Candidate({f"{CURRENTS}.bits": min(32, sensors.bits + 4)}, setting=False)


def slower_current_loops(study: Study) -> Iterator[Candidate]:
    """Candidates with a slower current loop."""
    loop = study.drive.current_loop
    for factor in TRIED_FACTORS:
        if isinstance(loop, CurrentLoop) and loop.bandwidth is not None:
            yield Candidate({f"{LOOP}.bandwidth": f"{_round(loop.bandwidth / factor):g} Hz"})
        elif isinstance(loop, CurrentLoop) and loop.kp is not None and loop.ki is not None:
            slower = {f"{LOOP}.kp": f"{loop.kp / factor:.4g} V/A"}
            yield Candidate({**slower, f"{LOOP}.ki": f"{loop.ki / factor:.4g} V/A/s"})


def _laws(study: Study, controller: str) -> Iterator[Candidate]:
    """A candidate with the law "harmonic", which learns all orders, on the same PI.

    No candidate if the study's law already learns all orders or has no PI.
    """
    law = study.controller[controller]
    if law.learns_every_order or not law.has_pi:
        return
    table = study.source.tables["controller"][controller]
    same = {key: table[key] for key in ("kp", "ki", "tuning", "baseline") if key in table}
    yield Candidate({f'controller."{controller}"': {"law": "harmonic", **same}})


def _gains(study: Study, controller: str) -> Iterator[Candidate]:
    law = study.controller[controller]
    key = f'controller."{controller}"'
    if law.given_pi is not None:
        kp, ki = law.given_pi
        yield Candidate({f"{key}.kp": f"{2 * kp:.4g} A*s/rad", f"{key}.ki": f"{2 * ki:.4g} A/rad"})
    half_width = getattr(law, "q_half_width", 0)
    if law.learns and half_width and not law.learns_functions:
        yield Candidate({f"{key}.q_half_width": half_width // 2})


def _limits(study: Study) -> Iterator[Candidate]:
    drive = study.drive
    yield Candidate({f"{LOOP}.current_limit": f"{_round(2 * drive.current_loop.current_limit):g} A"})
    if drive.inverter is not None:
        more = f"{_round(2 * drive.inverter.bus_voltage):g} V"
        yield Candidate({f"{INVERTER}.bus_voltage": more}, setting=False)


def _round(value: float) -> float:
    """The value rounded to two digits."""
    return float(f"{value:.2g}")
