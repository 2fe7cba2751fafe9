"""Position sensors: how they measure angle and speed, and their errors."""

from __future__ import annotations

import cmath
import math
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from cogless.study.csv_table import OverAngle, read
from cogless.study.table import Angle, File, Frequency, Many, Table, Time, check_one, excluded, invalid
from cogless.units import ANGLE

ORDER_MAX = 1000  # highest order of a sensor's error
ERROR_TABLE_ANGLES = 3600  # angles per revolution at which a table of the error is sampled


# words of datasheets: for the counts of both channels (four for each line), for the pulses of one channel
COUNT_WORDS, PULSES = (
    ("cpr", "counts", "counts_per_revolution", "resolution"),
    ("ppr", "pulses", "pulses_per_revolution"),
)


def _equals(key: str, value: Any) -> str:
    """The end of a message: key and number for the study; "" for a value that isn't a positive integer."""
    return f": {key} = {value}" if isinstance(value, int) and value > 0 else ""


class Mounted(Table):
    """A sensor on the shaft of the motor or of the load."""

    side: Literal["motor", "load"] = "motor"
    """Shaft on which the position sensor sits. From a sensor on the `load`, the drive computes the motor's
    angle and speed by the gear's ratio, which must be a whole number. Twist of the shaft and angle errors of
    the gear then disturb law and commutation."""


class IdealSensor(Mounted):
    """An ideal sensor, which gives the true angle and speed."""

    kind: Literal["ideal"] = "ideal"
    """An ideal sensor, which measures the true angle and speed."""


class AngleOrder(Table):
    """A part of a sensor's error: amplitude sin(order theta_m + phase)."""

    order: Annotated[int, Field(ge=1, le=ORDER_MAX)]
    """Order of this part of the sensor's error: number of its waves per mechanical revolution."""
    amplitude: Angle  # rad
    r"""Amplitude of this part of the sensor's angle error. The part is `amplitude` sin(`order` $\theta_m$ +
    `phase`) at the mechanical angle $\theta_m$."""
    phase: Angle = 0.0  # rad
    """Phase of this part of the sensor's error: 360 deg are one of its waves."""


class Counted(Mounted):
    """A sensor that shows the angle in steps; its speed follows from them."""

    kind: str
    """Kind of the position sensor. Each kind has further keys."""
    speed_method: Literal["M", "average", "T", "MT", "observer"] = "M"
    """How the drive measures the speed. `M`: counts in a period of the speed loop. `T`: time between two
    edges. `MT`: counts divided by the exact time between edges. `average`: as `M`, over `window`. `observer`:
    an observer of the angle. `M` is noisy if few counts come in a period, and laws learn this noise. `MT` is
    not noisy, but needs hardware that measures the times of edges. `T` and `MT` need an encoder."""
    window: Annotated[int, Field(ge=1, le=100_000)] = 16  # current-loop periods, with average only
    """Time over which the `speed_method` `average` measures the speed, in current-loop periods."""
    observer_bandwidth: Frequency | None = None  # Hz
    """Bandwidth of the observer that the `speed_method` `observer` needs. Choose at least three times the
    crossover frequency of the speed loop."""
    eccentricity: Angle = 0.0  # rad
    """Amplitude of the angle error with one wave per mechanical revolution, as of an eccentric sensor."""
    eccentricity_phase: Angle = 0.0  # rad
    """Phase of the angle error with one wave per mechanical revolution, whose amplitude is `eccentricity`."""
    error: Many[AngleOrder] = ()
    """Parts of the sensor's angle error, by order. They are added to the true angle."""
    error_table: File | None = None
    """CSV file of the sensor's angle error over the mechanical angle, with units in its first line: `angle
    [deg],error [deg]`. Give at least eight rising angles in one revolution. Between two angles the error is
    linear, also from the last angle to the first one of the next revolution, where it must not jump. The path
    is relative to the study."""
    latency: Time = 0.0  # s
    """Age of the measured angle, and of the speed that is computed from it. Not with the `speed_method` `T`
    or `MT`, which measures the times of edges."""
    _errors: OverAngle | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _of_a_method(self) -> Self:
        for key, method in (("observer_bandwidth", "observer"), ("window", "average")):
            is_set = key in self.model_fields_set and getattr(self, key) is not None
            if is_set and self.speed_method != method:
                raise excluded(
                    key,
                    "speed_method",
                    f'speed_method = "{self.speed_method}"',
                    f'set speed_method = "{method}"',
                )
        if self.observer_bandwidth is None and self.speed_method == "observer":
            expected = 'expected this key, since speed_method = "observer", such as "200 Hz"'
            raise invalid(expected, "observer_bandwidth", value="missing")
        if self.timed and self.latency:
            since = f'speed_method = "{self.speed_method}" times the edges'
            raise excluded("latency", "speed_method", since, 'set speed_method = "M"')
        slope = sum(abs(part["order"] * part["amplitude"]) for part in self.orders)
        if slope >= 1:
            expected = "expected waves whose products order * amplitude add up to less than 1 rad"
            raise invalid(
                f"{expected}: otherwise the measured angle runs backward",
                "error" if self.error else "eccentricity",
            )
        return self

    @model_validator(mode="after")
    def _file(self, info: ValidationInfo) -> Self:
        if self.error_table is None or not info.context:
            return self
        self._errors = read(info.context["folder"] / self.error_table, {"error": ANGLE}, "error_table")
        points = [*zip(self._errors.angle, self._errors.value, strict=True)]
        points.append((points[0][0] + math.tau, points[0][1]))
        if any(f - e <= a - b for (a, e), (b, f) in pairwise(points)):
            raise invalid(
                "expected an error that falls more slowly than the angle rises: otherwise the measured angle "
                "runs backward",
                "error_table",
            )
        return self

    @classmethod
    def other_word(cls, key: str, value: Any) -> str | None:
        word = key.lower()
        return cls._in_place(word, value) if word in COUNT_WORDS + PULSES else None

    @classmethod
    def _in_place(cls, word: str, value: Any) -> str | None:
        """The expectation for a datasheet's word for counts or pulses a revolution; None for other keys."""
        return None

    @property
    def counts(self) -> int:
        """Steps of the angle in a revolution."""
        raise NotImplementedError

    @property
    def step(self) -> float:
        """Angle of a step, rad."""
        return math.tau / self.counts

    @property
    def bandwidth(self) -> float:
        """Bandwidth of the observer that gives the speed, rad/s; 0 if there is none."""
        return math.tau * (self.observer_bandwidth or 0.0)

    @property
    def timed(self) -> bool:
        """Whether the speed is timed from edge to edge."""
        return self.speed_method in ("T", "MT")

    @property
    def each_law_period(self) -> bool:
        """Whether the speed is computed once per period of the outer loop, not of the current loop."""
        return self.speed_method in ("M", "T", "MT")

    @property
    def orders(self) -> list[dict[str, Any]]:
        """The error's orders: order, amplitude and phase (rad); eccentricity is the first."""
        first = {"order": 1, "amplitude": self.eccentricity, "phase": self.eccentricity_phase}
        return [first] * bool(self.eccentricity) + [order.model_dump() for order in self.error]

    def wave(self, order: int) -> complex:
        """An order of the whole error, amplitude e^(j phase), rad."""
        own = (cmath.rect(part["amplitude"], part["phase"]) for part in self.orders if part["order"] == order)
        return sum(own, self.wave_of_table(order))

    def wave_of_table(self, order: int) -> complex:
        """An order of `error_table`, amplitude e^(j phase), rad; the table is linear between its points."""
        if self._errors is None:
            return 0j
        import numpy as np

        angle = math.tau / ERROR_TABLE_ANGLES * np.arange(ERROR_TABLE_ANGLES)
        error = np.interp(angle, self._errors.angle, self._errors.value, period=math.tau)
        return complex(2j * np.mean(error * np.exp(-1j * order * angle)))

    def periods(self, divider: int) -> int:
        """Current-loop periods over which the speed is averaged; 0 with an observer.

        `divider`: current-loop periods per outer-loop period.
        """
        if self.speed_method == "observer":
            return 0
        return self.window if self.speed_method == "average" else divider

    def fields(self) -> dict[str, Any]:
        """What the engine reads."""
        table = self._errors
        return {
            "kind": self.kind,
            "side": self.side,
            "counts": float(self.counts),
            "speed_method": self.speed_method,
            "window": self.window,
            "bandwidth": self.bandwidth,
            "error": self.orders,
            "error_table": table and {"angle": list(table.angle), "error": list(table.value)},
            "latency": self.latency,
        }


class Encoder(Counted):
    """Incremental encoder with quadrature signals: four counts per line."""

    kind: Literal["encoder"]
    """An incremental encoder with quadrature signals."""
    lines: Annotated[int, Field(ge=1, le=10_000_000)]
    """Number of lines per mechanical revolution. Each line gives four counts."""
    timer: Frequency = 100e6  # Hz
    """Rate of the clock that measures the times of edges, for the `speed_method` `T` or `MT`."""

    @classmethod
    def _in_place(cls, word: str, value: Any) -> str:
        if word in PULSES:
            return f'expected "lines", the pulses of one channel{_equals("lines", value)}'
        if isinstance(value, int) and value % 4:
            either = "a quarter of the counts, or the number of cycles"
            return f'expected "lines": {either}{_equals("lines", value)}'
        quarter = _equals("lines", value // 4) if isinstance(value, int) else f": lines = {word} / 4"
        return f'expected "lines", a quarter of the counts{quarter}'

    @property
    def counts(self) -> int:
        return 4 * self.lines

    def fields(self) -> dict[str, Any]:
        return {**super().fields(), "timer": self.timer}


class Absolute(Counted):
    """Absolute encoder, whose word is the angle."""

    kind: Literal["absolute"]
    """An absolute encoder."""
    bits: Annotated[int, Field(ge=1, le=31)] | None = None
    """Number of bits: the encoder has $2^{bits}$ positions per mechanical revolution. Give `bits` or
    `positions`."""
    positions: Annotated[int, Field(ge=2, le=2**31)] | None = None
    """Number of positions per mechanical revolution. Give `bits` or `positions`."""
    speed_method: Literal["M", "average", "observer"] = "average"
    """How the drive measures the speed. `average`: change of the angle over the key `window`. `M`: change of
    the angle over a period of the speed loop. `observer`: an observer of the angle."""

    @classmethod
    def _in_place(cls, word: str, value: Any) -> str:
        return f'expected "positions" in place of bits{_equals("positions", value)}'

    @model_validator(mode="after")
    def _bits_or_positions(self) -> Self:
        check_one(
            self, ("bits", "positions"), "expected either bits, such as 14, or positions, such as 10000"
        )
        return self

    @property
    def counts(self) -> int:
        return self.positions or 1 << (self.bits or 0)


class Resolver(Counted):
    """Resolver and its digital converter."""

    kind: Literal["resolver"]
    """A resolver and its digital converter."""
    bits: Annotated[int, Field(ge=1, le=32)] = 14
    """Number of bits of the converter: it has $2^{bits}$ counts per mechanical revolution."""
    speed_method: Literal["M", "average", "observer"] = "average"
    """How the drive measures the speed. `average`: change of the angle over the key `window`. `M`: change of
    the angle over a period of the speed loop. `observer`: an observer of the angle."""

    @property
    def counts(self) -> int:
        return 1 << self.bits


class Hall(Table):
    """Three Hall sensors: six steps per electrical revolution, with the angle between them interpolated."""

    side: ClassVar[Literal["motor"]] = "motor"
    kind: Literal["hall"]
    """Three Hall sensors with six edges per electrical revolution. Between two edges the angle is
    extrapolated."""
    placement: Annotated[tuple[Angle, ...], Field(strict=False)] = (0.0,) * 6  # rad
    """Electrical angles by which the six edges come late. Without such errors the first edge is at the angle
    zero, and the next ones follow every 60 deg."""
    edges: Annotated[int, Field(ge=1, le=6)] = 6
    """Number of intervals between edges over which the speed is measured. Over six intervals the errors of
    `placement` cancel. Over fewer intervals the measured speed lags less."""
    timer: Frequency = 1e6  # Hz
    """Rate of the clock that measures the times of the Hall sensors' edges."""

    @model_validator(mode="after")
    def _apart(self) -> Self:
        if len(self.placement) != 6:
            raise invalid("expected six angles, one for each edge", "placement")
        if any(abs(late) >= math.radians(30) for late in self.placement):
            raise invalid(
                "expected less than 30 deg for each edge: otherwise edges change places", "placement"
            )
        return self

    def step(self, pole_pairs: int) -> float:
        """Mechanical angle from edge to edge, rad."""
        return math.tau / (6 * pole_pairs)

    def fields(self, pole_pairs: int) -> dict[str, Any]:
        """What the engine reads."""
        return {
            "kind": self.kind,
            "counts": 6.0 * pole_pairs,
            "window": self.edges,
            "timer": self.timer,
            "placement": [late / pole_pairs for late in self.placement],
        }


PositionSensor = Annotated[IdealSensor | Encoder | Absolute | Resolver | Hall, Field(discriminator="kind")]


def sensor_fields(sensor: IdealSensor | Counted | Hall, pole_pairs: int) -> dict[str, Any]:
    """A position sensor as the engine reads it."""
    if isinstance(sensor, Hall):
        return sensor.fields(pole_pairs)
    return sensor.fields() if isinstance(sensor, Counted) else sensor.model_dump()
