"""Studies that `cogless new` writes: they load, run, mark each guess, and follow the rules they state."""

import math
import random
import re
import tomllib
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from drafts import OWN, drafted_by_rules, request, written

from cogless.design.laws.harmonic import certificate, rival_bases
from cogless.design.settling import settling
from cogless.design.summary import summary
from cogless.design.warnings import beyond_drive, warnings
from cogless.errors import StudyError
from cogless.report import with_limits
from cogless.run.simulate import run_study
from cogless.starter import Draft, Request, draft, parse_number, parse_speeds
from cogless.starter.doubts import magnet_slip
from cogless.starter.motor_rules import Known, cogging_orders, layouts_for, sized
from cogless.starter.motor_sections import class_of, put_motor
from cogless.starter.part_catalogue import parts
from cogless.starter.ranking import outcome, shortened
from cogless.starter.request import NUMBERS, RequestError, names
from cogless.starter.sensor_choice import fit_observer
from cogless.starter.sheet import Sheet
from cogless.study import Study, changed
from cogless.study.laws.harmonic import Harmonic


def phases(motor: str) -> int:
    return 2 if motor.startswith(("nema", "krishnamurthy")) else 3


def drives_for(motor: str) -> list[str]:
    return [name for name, drive in parts("drives").items() if phases(motor) in drive.table["phases"]]


@pytest.mark.parametrize("motor", names("motors"))
def test_a_study_of_each_motor_encoder_and_drive_runs_and_marks_its_guesses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, motor: str
) -> None:
    drafted_by_rules(monkeypatch)
    drives = cycle(drives_for(motor))
    for encoder in parts("encoders"):
        made, study = written(tmp_path, request(motor, next(drives), encoder))
        assert made.tables == tomllib.loads((tmp_path / "mine.toml").read_text(encoding="utf-8"))
        check_marks(made)
        brief = changed(
            study,
            {
                "scenario.slow.duration": "50 ms",
                "metric": [{"name": "speed_ripple", "kind": "ripple-rms", "signal": "omega_m"}],
            },
        )
        results = run_study(brief)
        assert [run.controller for run in results.runs] == ["pi", "harmonic"]
        for run in results.runs:
            assert np.all(np.isfinite(run.trace["omega_m"]))


def check_marks(made: Draft) -> None:
    """Each guess has its range and a reason in the comment above its key, and each comment is a guess's."""
    lines = made.text.splitlines()
    assert max(map(len, lines)) <= 130
    for guess in made.guesses:
        key = guess.key.rsplit(".", 1)[-1]
        places = [n for n, line in enumerate(lines) if line.startswith(f"{key} = ")]
        comments = [comment_above(lines, place) for place in places]
        assert any(comment.startswith("guess: ") and len(comment) > 20 for comment in comments), guess
        assert guess.variants
        if guess.key != "motor.slots" and not guess.key.startswith(("motor.L_", "drive.position_sensor.pl")):
            assert any(comment.startswith(f"guess: {guess.span}; ") for comment in comments), guess


def comment_above(lines: list[str], place: int) -> str:
    first = place
    while first > 0 and lines[first - 1].startswith("# "):
        first -= 1
    return " ".join(line.removeprefix("#").strip() for line in lines[first:place])


COMBINATIONS = [
    (motor, drive, encoder)
    for motor in names("motors")
    for drive in drives_for(motor)
    for encoder in parts("encoders")
]


ANOTHER_SENSOR = {"drive.position_sensor.bits", "drive.position_sensor.lines"}


@pytest.mark.parametrize("combination", random.Random(40).sample(COMBINATIONS, 20), ids="-".join)
def test_a_fresh_study_has_no_warning_that_it_could_have_avoided(
    tmp_path: Path, combination: tuple[str, str, str]
) -> None:
    """The design knows a change against a warning: then the draft could have made it, unless it is a part."""
    _, study = written(tmp_path, request(*combination))
    (scenario,) = study.scenario
    remarks = [
        *beyond_drive(study, [scenario]),
        *(remark for name in study.controller for remark in warnings(study, scenario, name)),
    ]
    avoidable = [remark for remark in remarks if any(set(cure) - ANOTHER_SENSOR for cure in remark.cures)]
    assert [str(remark) for remark in avoidable] == []


@pytest.mark.parametrize("motor", ["drone", "direct-drive", "gimbal", "liu2018"])
def test_of_two_bases_the_one_with_less_ripple_is_written(tmp_path: Path, motor: str) -> None:
    """One learns all the cogging, one the error of the sensor. No base does both with an AS5047."""
    _, study = written(tmp_path, request(motor, "odrive", "as5047"))
    learner, rivals = study.controller["harmonic"], rival_bases(study, "harmonic")
    assert isinstance(learner, Harmonic) and rivals is not None
    (other,) = set(rivals) - {learner.base}
    (scenario,) = study.scenario
    (ripple, more) = (
        run_study(variant, ["*/harmonic"]).runs[0].metrics["speed_ripple_rad_s"]
        for variant in (study, changed(study, {"controller.harmonic.base": other}))
    )
    assert ripple < more
    assert warnings(study, scenario, "harmonic") == []


@pytest.mark.parametrize("motor", ["gimbal", "drone"])
def test_the_run_that_chose_the_base_is_the_run_of_the_file(tmp_path: Path, motor: str) -> None:
    """The comment's time and its ripple are those of `cogless run`."""
    made, study = written(tmp_path, request(motor, "odrive", "as5047"))
    comment = re.search(
        r"in the run of ([0-9.]+) s below, with these numbers: (.*?) base = ",
        " ".join(made.text.replace("#", "").split()),
    )
    assert comment is not None and float(comment[1]) == study.scenario["slow"].duration
    ripples = dict(re.findall(r"base ([0-9]+) ([0-9.]+) rpm", comment[2]))
    (run,) = run_study(study, ["slow/harmonic"]).runs
    base = str(study.controller["harmonic"].base)
    assert float(ripples[base]) == pytest.approx(
        float(run.metrics["speed_ripple_rad_s"]) * 30 / math.pi, rel=0.01
    )


SETTINGS = {
    "servo": ("servo", "generic", "absolute", {"pole_pairs": 4, "torque_constant": 1.28, "resistance": 2.9,
              "inductance": 9.4, "inertia": "1.4 kg cm^2", "rated_current": 3.2, "bus_voltage": 560,
              "bits": 20, "speed": 30}),
    "gimbal": ("own", "moteus", "as5047", {"pole_pairs": 7, "kv": 58, "resistance": 5.6}),
}  # fmt: skip


@pytest.mark.parametrize("name", SETTINGS)
def test_run_advises_no_setting_that_new_could_have_written(tmp_path: Path, name: str) -> None:
    """An observer of another bandwidth; on a board of one's own, compensation of dead time, too."""
    motor, drive, encoder, numbers = SETTINGS[name]
    _, study = written(tmp_path, request(motor, drive, encoder, **numbers))
    found = with_limits(run_study(study, ["slow/harmonic"])).limits["slow"]
    assert found.setting is None or not any(
        key.startswith(("drive.position_sensor.observer", "drive.dead_time")) for key in found.setting.changes
    )


def test_what_new_chooses_by_runs_leaves_less_than_its_rules(tmp_path: Path) -> None:
    motor, drive, encoder, numbers = SETTINGS["servo"]
    made, study = written(tmp_path, request(motor, drive, encoder, **numbers))
    assert any(remark.startswith("The study has drive.dead_time_compensation") for remark in made.remarks)
    by_rule = {f"drive.position_sensor.{key}": value for key, value in fit_observer(study).items()}

    def ripple(**changes: object) -> float:
        (run,) = run_study(changed(study, changes), ["slow/harmonic"]).runs
        return float(run.metrics["speed_ripple_rad_s"])

    assert ripple() < 0.8 * ripple(**{"drive.dead_time_compensation": None})
    assert ripple() <= ripple(**by_rule)


def test_an_own_firmware_alone_is_given_a_compensation(tmp_path: Path) -> None:
    motor, _, encoder, numbers = SETTINGS["servo"]
    made, _ = written(tmp_path, request(motor, "odrive", encoder, **{**numbers, "bus_voltage": 48}))
    assert "dead_time_compensation" not in made.text


def test_an_order_that_neither_base_learns_is_named(tmp_path: Path) -> None:
    """24 slots and 22 poles have order 264; base 2 with 128 orders ends at 256."""
    of = request("gimbal", "simplefoc", "as5048", pole_pairs=11, slots=24, resistance=11.1, kv=24)
    made, study = written(tmp_path, of)
    assert "either base 2 learns all orders of the cogging but 264, or base " in " ".join(made.text.split())
    for base, orders, missing in ((2, "2, 4, ..., 256", 264), (6, "6, 12, ..., 768", 22)):
        (remark,) = warnings(changed(study, {"controller.harmonic.base": base}), "slow", "harmonic")
        learns = f"it learns orders {orders}, but the cogging has order {missing}"
        assert f"{learns}; no base learns all of the cogging" in str(remark)


STRANGERS = [
    {"pole_pairs": 1, "kv": 1000, "resistance": 0.1, "bits": 8, "current_rate": 30_000, "speed": 3000},
    {"pole_pairs": 1, "kv": 1000, "resistance": 0.1, "bits": 20, "current_rate": 1000, "speed": 3000},
    {"pole_pairs": 50, "kv": 10, "resistance": 2, "bits": 20, "current_rate": 1000, "speed": 0.1},
    {"pole_pairs": 50, "kv": 10, "resistance": 2, "bits": 20, "current_rate": 30_000, "speed": 5},
    {"pole_pairs": 1, "kv": 1000, "resistance": 0.1, "bits": 8, "current_rate": 10_000, "speed": 0.1},
    {"pole_pairs": 21, "kv": 40, "resistance": 0.5, "cpr": 16_384, "current_rate": 20_000, "speed": 5},
    {"pole_pairs": 4, "torque_constant": 0.5, "resistance": 1.5, "inductance": 4, "bits": 17, "speed": 600,
     "current_rate": 16_000, "rated_current": 8, "inertia": 1e-3},
    {"pole_pairs": 7, "kv": 2300, "resistance": 0.08, "bits": 12, "current_rate": 24_000, "speed": 60,
     "bus_voltage": 14.8, "inertia": 5e-6},
    {"pole_pairs": 11, "back_emf": "33 mV/rpm", "resistance": 12, "bits": 14, "current_rate": 9973,
     "speed": 3, "cogging": 0.01, "inertia": 2e-3},
    {"pole_pairs": 14, "rated_torque": 2, "rated_current": 20, "resistance": 0.2, "bits": 16, "speed": 20},
]  # fmt: skip
HOLDS = {3, 5, 7, 8, 9}  # those of which the speed must be held


@pytest.mark.parametrize("place", range(len(STRANGERS)))
def test_a_strangers_motor_holds_its_speed_or_says_why_not(tmp_path: Path, place: int) -> None:
    numbers = STRANGERS[place]
    encoder = "incremental" if "cpr" in numbers else "absolute"
    of = Request(
        "own",
        "generic",
        encoder,
        {flag.replace("_", "-"): parse_number(flag.replace("_", "-"), str(v)) for flag, v in numbers.items()},
    )
    _, study = written(tmp_path, of)
    short = shortened(study)
    (run,) = run_study(short, ["slow/harmonic"]).runs
    answer = outcome(short, run)
    last = run.trace.time >= run.trace.time[-1] - (short.metric[0].last or 0.0)
    mean = float(np.mean(np.asarray(run.trace["omega_m"])[last]))
    wanted = float(numbers["speed"]) * math.pi / 30
    if answer.holds:
        assert mean == pytest.approx(wanted, rel=0.05)
    else:
        assert len(answer.why) > 10
    assert place not in HOLDS or answer.holds, answer


# rules


def test_a_rotor_that_is_a_little_slow_still_turns_once_in_the_window_of_orders(tmp_path: Path) -> None:
    """A mean of 4.99 r/min in a window of exactly one turn has no orders."""
    _, study = written(tmp_path, request("hub", "vesc", "as5048", speed="5"))
    order = next(metric for metric in study.metric if metric.kind == "order")
    assert order.last is not None and order.last * 0.97 * 5 / 60 > 1
    assert all(metric.last == pytest.approx(12.0) for metric in study.metric if metric is not order)


def test_a_step_motor_has_its_holding_torque_and_its_detent(tmp_path: Path) -> None:
    of = request(
        "nema17",
        "stepper",
        "incremental",
        holding_torque=0.45,
        rated_current=1.5,
        detent_torque=0.02,
        friction=0.005,
    )
    _, study = written(tmp_path, of)
    star = study.motor.star()
    assert star.pole_pairs == 50 and star.phases == 2
    assert star.K_t * math.sqrt(2) * 1.5 == pytest.approx(0.45, rel=1e-3)
    (detent,) = star.cogging
    assert detent.order == 4 * 50
    assert abs(detent.torque) == pytest.approx(0.02 - 0.005, rel=1e-3)


def test_kv_and_resistance_between_terminals_reach_the_plant(tmp_path: Path) -> None:
    _, study = written(
        tmp_path, request("own", "generic", "absolute", kv=100, resistance=0.6, inductance=0.2)
    )
    star = study.motor.star()
    volts_per_speed = 1 / (100 * math.pi / 30)  # peak, between two lines
    assert star.psi_f == pytest.approx(volts_per_speed / math.sqrt(3) / 7, rel=1e-6)
    assert (star.R_s, star.L_d) == (pytest.approx(0.3), pytest.approx(1e-4))


def test_a_class_scaled_to_itself_is_itself() -> None:
    for motor in parts("motors").values():
        size = sized(motor, Known())
        assert (size.resistance_factor, size.inductance_factor, size.inertia_factor) == (
            pytest.approx(1), pytest.approx(1), pytest.approx(1)
        )  # fmt: skip


def test_a_motor_of_twice_the_size_follows_the_rules_of_scale() -> None:
    """All lengths twice: torque 8, inertia 32, L / R 4, copper loss 4 times as large, with the same K_t."""
    motor = parts("motors")["drone"]
    own = sized(motor, Known())
    size = sized(motor, Known(torque=8 * own.torque, torque_constant=own.torque_constant))
    assert size.inertia_factor == pytest.approx(32)
    assert size.inductance_factor / size.resistance_factor == pytest.approx(4)
    loss = size.resistance_factor * (size.current / own.current) ** 2
    assert loss == pytest.approx(4)
    # and back: this resistance tells that torque
    told = sized(
        motor,
        Known(
            torque_constant=own.torque_constant,
            resistance=size.resistance_factor * motor["resistance"].typical,
        ),
    )
    assert told.torque == pytest.approx(size.torque)


@pytest.mark.parametrize("pole_pairs", [*range(1, 30), 50])
def test_slots_that_are_guessed_carry_a_balanced_winding(pole_pairs: int) -> None:
    """Turned by 120 degrees electrical, the slots' voltages are the same set: three phases are alike."""
    layouts = layouts_for(parts("motors")["own"], pole_pairs)
    assert layouts and all(poles == 2 * pole_pairs for _, poles in layouts)
    for slots, _ in layouts:
        angles = [(k * pole_pairs * 3) % (3 * slots) for k in range(slots)]  # in 1/(3 slots) of a turn
        turned = [(angle + slots) % (3 * slots) for angle in angles]
        assert Counter(angles) == Counter(turned), slots


def test_the_main_order_of_the_cogging_is_that_of_a_motor_of_teeth_and_magnets() -> None:
    """Cogging is the sum over slots of what each tooth sees of each magnet."""
    for slots, poles in ((12, 14), (18, 24), (27, 30), (9, 8), (6, 2)):
        angle = 2 * np.pi * np.arange(4096) / 4096
        torque = sum(
            np.sum([np.sin(m * poles * (angle + 2 * np.pi * k / slots)) / m for k in range(slots)], axis=0)
            for m in range(1, 40)
        )
        spectrum = np.abs(np.fft.rfft(torque))
        lowest = int(np.flatnonzero(spectrum > 1e-6 * spectrum.max())[0])
        assert cogging_orders(slots, poles)["cogging"] == lowest


def test_cogging_grows_with_the_common_divisor_of_slots_and_poles(tmp_path: Path) -> None:
    torques = []
    for slots, pole_pairs in ((12, 7), (18, 12)):
        of = request("own", "generic", "absolute", slots=slots, pole_pairs=pole_pairs, rated_torque=1)
        torques.append(written(tmp_path, of)[1].motor.star().cogging[0].torque)
    assert torques[1] / torques[0] == pytest.approx(math.gcd(18, 24) / math.gcd(12, 14), rel=0.01)


def test_the_rated_torque_bounds_the_current(tmp_path: Path) -> None:
    _, study = written(tmp_path, request("gm5208", "generic", "as5048", rated_torque="0.2 N*m"))
    assert study.drive.current_loop.current_limit == pytest.approx(0.2 / study.motor.star().K_t, rel=0.01)


@pytest.mark.parametrize(
    ("motor", "drive", "encoder"), [("gm5208", "generic", "as5048"), ("own", "moteus", "as5047")]
)
def test_an_observer_is_three_times_as_fast_as_the_crossover(
    tmp_path: Path, motor: str, drive: str, encoder: str
) -> None:
    _, study = written(tmp_path, request(motor, drive, encoder))
    crossovers = [d.margins.crossover for d in summary(study).values() if d.margins]
    sensor = study.drive.position_sensor
    assert 2 * math.pi * sensor.observer_bandwidth / max(crossovers) == pytest.approx(3, rel=0.06)


def test_an_observer_is_no_faster_than_counts_come(tmp_path: Path) -> None:
    _, study = written(tmp_path, request("gm5208", "generic", "absolute", bits=8, speed=20))
    counts = 256 * 20 / 60
    assert study.drive.position_sensor.observer_bandwidth <= 3 * counts / (2 * math.pi) * 1.02


def test_edges_are_timed_where_the_drive_can_and_they_come_often(tmp_path: Path) -> None:
    fast = request("uomodri", "generic", "incremental", cpr=20_000, speed=60)
    assert written(tmp_path, fast)[1].drive.position_sensor.speed_method == "MT"
    slow = request("uomodri", "generic", "incremental", cpr=400, speed=5)
    assert written(tmp_path, slow)[1].drive.position_sensor.speed_method == "observer"
    counting = request("uomodri", "odrive", "incremental", cpr=20_000, speed=60)
    assert written(tmp_path, counting)[1].drive.position_sensor.speed_method == "observer"


def test_a_datasheets_value_is_replaced_by_what_is_given(tmp_path: Path) -> None:
    _, study = written(
        tmp_path, request("gm5208", "generic", "as5048", pole_pairs=11, slots=24, kv=30, resistance=9)
    )
    star = study.motor.star()
    assert (star.pole_pairs, study.motor.slots, star.R_s) == (11, 24, pytest.approx(4.5))
    assert star.K_t == pytest.approx(math.sqrt(3) / 2 / (30 * math.pi / 30))
    assert star.L_d == pytest.approx(4.49e-3)
    assert [wave.order for wave in star.cogging] == [264, 24, 22]


def test_what_is_given_stays_as_it_was_written(tmp_path: Path) -> None:
    made, study = written(
        tmp_path,
        request(
            "own", "generic", "absolute", bits=17, kv="58 rpm/V", inertia="400 g*cm^2", friction="3 mN*m",
            cogging="4 mN*m", bus_voltage=24, current_limit=1.5, current_rate="20 kHz", speed_rate="4 kHz",
            speed="3.1 rad/s", load="10 mN*m", slots=12,
        ),
    )  # fmt: skip
    tables = made.tables
    assert tables["motor"]["kv"] == "58 rpm/V" and tables["motor"]["slots"] == 12
    assert tables["mechanics"]["inertia"] == "400 g*cm^2"
    assert tables["mechanics"]["load"] == {"torque": "10 mN*m"}
    assert tables["scenario"]["slow"]["reference"] == "3.1 rad/s"
    assert study.drive.rates.outer_loop == 4000
    guessed = {guess.key for guess in made.guesses}
    given = (
        "motor.kv",
        "mechanics.inertia",
        "mechanics.coulomb_friction",
        "motor.slots",
    )
    assert not guessed & {*given, "drive.inverter.bus_voltage", "drive.current_loop.current_limit"}


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"speed_rate": 3000, "current_rate": 20_000},
         '--speed-rate: "3000 Hz": expected a rate that divides the current loop\'s, 20000 Hz'),
        ({"kv": 80, "torque_constant": 0.95},
         '--kv: "80 rpm/V": expected about 8.71 rpm/V, as --torque-constant 0.95 N*m/A says; '
         "give one of the two"),
        # Maxon EC 45 flat, 70 W
        ({"kv": 259, "torque_constant": 0.0369},
         '--kv: "259 rpm/V": expected about 224 rpm/V, as --torque-constant 0.0369 N*m/A says; this torque '
         "constant is per ampere of the supply (block commutation); give --kv alone"),
        ({"kv": 80, "back_emf": "33 mV/rpm"},
         '--back-emf: "33 mV/rpm": expected about 0.00884 V/rpm, as --kv 80 rpm/V says; give one of the two'),
        ({"current_rate": "2.5 Hz"}, '--current-rate: "2.5 Hz": expected a whole number of Hz'),
        ({"bus_voltage": 2}, '--bus-voltage: "2 V": expected 5 to 800 V, the range of generic'),
        ({"holding_torque": 1},
         '--holding-torque: "1 N*m": expected no such option, unless the motor has two phases, a step motor'),
    ],
)  # fmt: skip
def test_answers_that_do_not_go_together(tmp_path: Path, numbers: dict[str, object], message: str) -> None:
    with pytest.raises(RequestError) as error:
        draft(request("own", "generic", "absolute", **numbers), "Mine", tmp_path / "mine.toml")
    assert str(error.value) == message


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"step_angle": 1.7},
         '--step-angle: "1.7 deg": expected 360 deg divided by four times the number of teeth, such as 1.8 '
         'deg'),
        ({"kv": 100}, '--kv: "100 rpm/V": expected no such option, unless the motor has three phases'),
    ],
)  # fmt: skip
def test_answers_that_do_not_go_with_a_step_motor(
    tmp_path: Path, numbers: dict[str, object], message: str
) -> None:
    with pytest.raises(StudyError) as error:
        draft(request("nema17", "stepper", "incremental", **numbers), "Mine", tmp_path / "mine.toml")
    assert str(error.value) == message


def test_a_speed_that_nobody_asked_for_is_one_at_which_the_rotor_turns(tmp_path: Path) -> None:
    _, study = written(tmp_path, request("nema17", "stepper", "incremental"))
    made, _ = written(tmp_path, request("nema17", "stepper", "incremental", speed=5))
    assert re.search(r"does not\n#   snap|does not snap", (tmp_path / "mine.toml").read_text()) is None
    assert made.tables["scenario"]["slow"]["reference"] == "5 rpm"
    short = shortened(study)
    (run,) = run_study(short, ["slow/harmonic"]).runs
    assert outcome(short, run).holds


HUB = {"pole_pairs": 20, "slots": 36, "speed": 20}


def cogging_swing(study: Study) -> float:
    """Half of peak to peak of the cogging, N*m, on a fine grid of a turn."""
    theta = np.linspace(0, 2 * np.pi, 200_001)
    star = study.motor.star()
    torque = sum(wave.torque * np.sin(wave.order * theta + wave.phase) for wave in star.cogging)
    return float(np.ptp(torque)) / 2


@pytest.mark.parametrize("layout", [{}, HUB, {"pole_pairs": 23, "slots": 51}])
def test_a_stated_cogging_is_half_of_peak_to_peak_of_the_sum_of_its_orders(
    tmp_path: Path, layout: dict[str, object]
) -> None:
    """What a hand feels is the sum, in each split that the file calls possible."""
    made, study = written(tmp_path, request("hub", "vesc", "as5048", cogging=0.3, **layout))
    assert cogging_swing(study) == pytest.approx(0.3, rel=5e-3)
    (split,) = (guess for guess in made.guesses if guess.key == "motor.cogging.0.torque")
    for change in split.variants.values():
        assert cogging_swing(changed(study, change)) == pytest.approx(0.3, rel=5e-3)
    waves = study.motor.star().cogging
    slot, pole = (abs(wave.torque) for wave in waves[1:])
    assert slot == pytest.approx(pole)  # as in the class
    (remark,) = (remark for remark in made.remarks if remark.startswith("Cogging: "))
    assert remark.startswith("Cogging: 0.3 N*m, half of peak to peak of the sum of ")


def test_other_slots_have_the_same_cogging_in_all(tmp_path: Path) -> None:
    made, study = written(tmp_path, request("hub", "vesc", "as5048", cogging=0.3))
    (slots,) = (guess for guess in made.guesses if guess.key == "motor.slots")
    for change in slots.variants.values():
        assert cogging_swing(changed(study, change)) == pytest.approx(0.3, rel=5e-3)


def test_a_stated_cogging_of_a_step_motor_is_its_detent(tmp_path: Path) -> None:
    of = request("nema17", "stepper", "incremental", cogging="12 mN*m", friction=0.005)
    assert cogging_swing(written(tmp_path, of)[1]) == pytest.approx(0.012, rel=1e-3)


def test_no_cogging_is_none(tmp_path: Path) -> None:
    assert cogging_swing(written(tmp_path, request("hub", "vesc", "as5048", cogging=0))[1]) == 0


def test_a_sensor_that_is_read_more_slowly_than_the_current_loop_runs_is_doubted(tmp_path: Path) -> None:
    """404 us a reading are 2475 a second."""
    doubt = (
        "as5600: a reading takes 404 us, but the study assumes a new angle in each period of a current loop "
        "at 5 kHz; if your drive reads the angle in each period, give --current-rate 2 kHz or less"
    )
    assert written(tmp_path, request("gimbal", "simplefoc", "as5600"))[0].doubts == (doubt,)
    for encoder, numbers in (("as5600", {"current_rate": "2 kHz"}), ("as5047", {})):
        assert written(tmp_path, request("gimbal", "simplefoc", encoder, **numbers))[0].doubts == ()


def test_a_winding_of_a_phase_is_doubled_between_terminals(tmp_path: Path) -> None:
    of = request("hub", "vesc", "as5048", resistance="0.28 ohm/phase", inductance="0.55 mH per phase", **HUB)
    made, study = written(tmp_path, of)
    star = study.motor.star()
    assert (star.R_s, star.L_d) == (pytest.approx(0.28), pytest.approx(0.55e-3))
    assert made.tables["motor"]["resistance_line_to_line"] == "0.56 ohm"
    assert made.remarks == (
        "Winding: 0.56 ohm between two terminals = 0.28 ohm per phase; "
        "1.1 mH between two terminals = 0.55 mH per phase.",
    )
    step = request("nema17", "stepper", "incremental", resistance="1.5 ohm/phase")
    assert written(tmp_path, step)[1].motor.star().R_s == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("numbers", "doubt"),
    [
        ({"inertia": 210}, '--inertia: "210 kg*m^2": '),
        ({"inductance": "0.55uH"}, "; perhaps you mean 0.55 mH"),
        ({"cogging": 300}, "; perhaps you mean 300 mN*m"),
        ({"slots": 37}, "--slots: 37: no winding has three equal phases with 40 poles: "
                        "expected a number such as 36 or 39"),
        ({"inertia": None, "load_inertia": 400}, "usual value of the load of such a motor, "),
        ({"inertia": None, "load_inertia": 0.64}, ""),
        ({"inertia": 0.021, "inductance": 0.55, "cogging": 0.3, "friction": 0.1}, ""),
    ],
)  # fmt: skip
def test_a_number_far_from_the_class_is_doubted(
    tmp_path: Path, numbers: dict[str, object], doubt: str
) -> None:
    all_numbers = {**HUB, "torque_constant": 0.95, "resistance": 0.56, **numbers}
    stated = {flag: number for flag, number in all_numbers.items() if number is not None}
    of = request("hub", "vesc", "as5048", **stated)
    doubts = draft(of, "Mine", tmp_path / "mine.toml").doubts
    assert (len(doubts), doubt in "".join(doubts)) == (bool(doubt), True)


@pytest.mark.parametrize(
    ("numbers", "conflict", "meant"),
    [
        ({"torque_constant": 36.9, "speed": 20}, "but --speed is 20 rpm", "36.9 mN*m/A"),
        ({"torque_constant": 36.9, "speed": 5}, "and with 0.5 ohm its torque at standstill would be 2050 N*m",
         "36.9 mN*m/A"),
        ({"torque_constant": 36.9, "speed": 5, "rated_torque": 0.18, "rated_current": 5},
         "and rated torque over rated current is 36 mN*m/A", "36.9 mN*m/A"),
        ({"torque_constant": "0.0369 mN*m/A", "speed": 20},
         "and with 0.5 ohm its torque at standstill would be 2.05 mN*m", "0.0369 N*m/A"),
        ({"back_emf": 4.5, "speed": 20}, "but --speed is 20 rpm", "4.5 mV/rpm"),
    ],
)  # fmt: skip
def test_a_constant_of_the_magnet_in_another_unit_is_doubted_itself(
    numbers: dict[str, object], conflict: str, meant: str
) -> None:
    """Not the resistance that fits. At no load two phases have the bus voltage: K_t / sqrt(3) per rad/s."""
    of, doubt = slip_of(numbers)
    flag = "back-emf" if "back_emf" in numbers else "torque-constant"
    assert doubt.startswith(f'--{flag}: "{of.numbers[flag].text}": with it 24 V turn the motor at ')
    assert f" rpm at most, {conflict}; perhaps you mean {meant}, which gives " in doubt
    K_t = of.numbers[flag].value * (math.sqrt(3 / 2) if flag == "back-emf" else 1)
    words = re.search(r"at ([0-9.]+) rpm at most.* which gives ([0-9.]+) rpm$", doubt)
    assert words is not None
    assert float(words[1]) == pytest.approx(24 * math.sqrt(3) / 2 / K_t * 60 / math.tau, rel=0.01)
    assert abs(math.log10(float(words[2]) / float(words[1]))) == pytest.approx(3, abs=0.01)


def slip_of(numbers: dict[str, object]) -> tuple[Request, str]:
    of = request("own", "generic", "as5047", bus_voltage=24, **numbers)
    of = replace(of, numbers={flag: answer for flag, answer in of.numbers.items() if flag != "kv"})
    return of, magnet_slip(of, put_motor(Sheet(), of, class_of(of)), 24.0)


def test_a_slip_of_the_constants_unit_is_the_only_doubt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drafted_by_rules(monkeypatch)
    of, doubt = slip_of({"back_emf": 4.5, "speed": 20})
    made = draft(of, "Mine", tmp_path / "mine.toml")
    assert [*made.doubts] == [doubt] and not made.unusual


@pytest.mark.parametrize(
    "numbers",
    [
        {"torque_constant": "36.9 mN*m/A", "speed": 20},
        {"torque_constant": "36.9 mN*m/A", "speed": 8000},  # beyond the bus voltage in any unit
        {"torque_constant": "36.9 mN*m/A", "speed": 20, "resistance": 500},  # the resistance's own slip
    ],
)
def test_a_constant_that_no_other_unit_mends_is_not_doubted(
    numbers: dict[str, object],
) -> None:
    assert slip_of(numbers)[1] == ""


def test_a_resistance_is_doubted_by_the_torque_that_it_means(tmp_path: Path) -> None:
    """Small motors of 9.55 mN*m/A and 0.6 ohm are sold with 25 to 50 mN*m: it is no slip of a unit."""
    numbers = {"pole_pairs": 1, "kv": 907, "resistance": 0.611, "bits": 12, "speed": 3000}
    (doubt,) = draft(request("own", "generic", "absolute", **numbers), "Mine", tmp_path / "mine.toml").doubts
    words = re.fullmatch(
        r'--resistance: "0.611 ohm": with this resistance the motor has a torque of about ([0-9.]+) mN\*m; '
        r"if yours has another torque, give --rated-torque, or perhaps you mean 0.611 mohm",
        doubt,
    )
    assert words is not None and 20 < float(words[1]) < 60
    rated = request("own", "generic", "absolute", **numbers, rated_torque="40 mN*m")
    assert draft(rated, "Mine", tmp_path / "mine.toml").doubts == ()


def test_no_resistance_of_a_motor_of_unknown_size_is_unusual(tmp_path: Path) -> None:
    """A hub motor of 0.2 ohm, by its numbers alone."""
    of = request("own", "vesc", "hall", pole_pairs=15, kv=16, resistance=0.2, speed=20)
    assert draft(of, "Mine", tmp_path / "mine.toml").unusual == ()


@pytest.mark.parametrize(
    ("flag", "text", "value"),
    [
        ("kv", "270 KV", 270 * math.tau / 60),
        ("back-emf", "58 V/1000rpm", 0.058 * 60 / math.tau),
        ("torque-constant", "1.28 Nm/Arms", 1.28 / math.sqrt(2)),
        ("rated-current", "2.8 A rms", 2.8 * math.sqrt(2)),
        ("rated-current", "2.8A/phase", 2.8),
        ("current-limit", "10 Arms", 10 * math.sqrt(2)),
        ("inductance", "0.35 mH line to line", 0.35e-3),
        ("resistance", "55mΩ l-l", 0.055),
        ("bits", "14 bit", 14),
        ("bits", "14-bit", 14),
        ("cpr", "2048 PPR", 8192),
        ("cpr", "1000 lines", 4000),
        ("cpr", "8192 cpr", 8192),
        ("pole-pairs", "14 poles", 7),
        ("pole-pairs", "7 pole pairs", 7),
    ],
)
def test_a_number_may_stand_as_its_datasheet_has_it(flag: str, text: str, value: float) -> None:
    answer = parse_number(flag, text)
    assert answer.value == pytest.approx(value, rel=1e-5)
    as_written = parse_number(flag, answer.text)  # what stands in the study
    assert as_written.value == pytest.approx(value, rel=1e-5) and not as_written.written


def test_what_was_taken_for_another_number_is_said(tmp_path: Path) -> None:
    made, _ = written(
        tmp_path, request("servo", "generic", "absolute", rated_current="2 Arms", bits=20, speed=60)
    )
    assert "--rated-current 2 Arms: taken as 2.82843 A." in made.remarks
    with pytest.raises(RequestError, match=re.escape('--pole-pairs: "15 poles": expected a whole number')):
        parse_number("pole-pairs", "15 poles")
    with pytest.raises(RequestError, match="expected the current of each coil at rest, such as"):
        draft(
            request("nema23", "stepper", "incremental", rated_current="2.8 Arms"),
            "Mine",
            tmp_path / "mine.toml",
        )


def test_a_load_of_a_hundred_kilograms_on_a_small_step_motor_is_doubted(tmp_path: Path) -> None:
    """42BYG228 has 22 g cm^2 and longer motors of its size fourfold: ten times these are 820 g cm^2."""
    of = request("nema17", "stepper", "as5048", load_inertia=100)
    (doubt,) = draft(of, "Mine", tmp_path / "mine.toml").doubts
    assert doubt.startswith(
        '--load-inertia: "100 kg*m^2": 1200000 times the largest usual value of the load '
    )
    assert doubt.endswith(", 8.2e-5 kg*m^2; perhaps you mean 100 g*cm^2")


def test_each_speed_is_a_scenario(tmp_path: Path) -> None:
    of = replace(
        request("hub", "vesc", "as5048", **{**HUB, "speed": 5}), faster=parse_speeds(["40, 7.5 rpm"])
    )
    _, study = written(tmp_path, of)
    assert {name: s.top_reference * 30 / math.pi for name, s in study.scenario.items()} == {
        "at_5_rpm": pytest.approx(5),
        "at_7_5_rpm": pytest.approx(7.5),
        "at_40_rpm": pytest.approx(40),
    }
    with pytest.raises(RequestError, match=re.escape('"5,40": expected "5.40", or "5, 40"')):
        parse_speeds(["5,40"])


SLIPS = [
    "1", "0.02", "700", "1e-6", "3 mN*m", "0.3 ohm/phase", "2 rad/s", "20 kHz", "12", "4096", "33 mV/rpm",
    "80 rpm/V",
]  # fmt: skip


def test_any_flags_make_a_study_or_one_line(tmp_path: Path) -> None:
    """Numbers drawn at random, mostly absurd together: a study or a StudyError, no other exception."""
    generator = random.Random(7)
    made = 0
    for _ in range(8):
        motor = generator.choice([*names("motors")])
        encoder = generator.choice([*parts("encoders")])
        numbers = {}
        for flag in generator.sample([*NUMBERS], 3):
            with suppress(StudyError):
                numbers[flag] = parse_number(flag, generator.choice(SLIPS))
        base = {flag: parse_number(flag, text) for flag, text in OWN.items()} if motor == "own" else {}
        of = Request(motor, generator.choice(drives_for(motor)), encoder, base | numbers)
        with suppress(StudyError):
            draft(of, "Mine", tmp_path / "mine.toml")
            made += 1
    assert made > 0


@pytest.mark.parametrize(
    ("drive", "encoder", "speed"), [("vesc", "as5047", 100), ("simplefoc", "as5600", 45)]
)
def test_a_run_lasts_until_the_law_has_learned(tmp_path: Path, drive: str, encoder: str, speed: int) -> None:
    """By twice the model's time, before the metrics are taken."""
    study = written(tmp_path, request("gimbal", drive, encoder, speed=speed))[1]
    times = settling(study, "harmonic", certificate(study, "harmonic"))
    (ripple,) = (metric for metric in study.metric if metric.name == "speed_ripple")
    assert times and ripple.last is not None
    assert all(at_speed.duration - ripple.last >= at_speed.time for at_speed in times)
    assert study.scenario["slow"].duration > 6.0 or times[0].time < 2.0
