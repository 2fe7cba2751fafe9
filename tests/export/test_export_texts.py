"""What an export tells the one who wires it up, sentence by sentence, by kinds of controllers and boards."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from string import Template
from types import SimpleNamespace
from typing import Any

import pytest

import studies
from cogless.control_library import C_LAWS
from cogless.export.c.export_c import self_test_ticks, subject_of
from cogless.export.c.parts import extras, parts
from cogless.export.c.subject import Subject
from cogless.export.c.texts import (
    _left_out_check,
    _precision_check,
    _reset_comment,
    _template_words,
    board,
    figure_lines,
    matrix_array,
    plain_comment,
    verdict_comment,
)
from cogless.export.fmu.variables import duties, measurements
from cogless.export.prepared import prepare
from cogless.study import load


@pytest.fixture(scope="module")
def subject(tmp_path_factory: pytest.TempPathFactory) -> Subject:
    """A PI law every 15 periods of a drive of three phases, with an ideal sensor."""
    return subject_of(prepare(studies.study(tmp_path_factory.mktemp("texts")), "low", "pi"))


def changed(subject: Subject, law: str = "pi", foc: dict[str, Any] | None = None, **drive: Any) -> Subject:
    config = subject.drive_config
    config = {**config, **drive, "foc": {**config["foc"], **(foc or {})}}
    return replace(subject, law=C_LAWS[law], drive_config=config)


@pytest.mark.parametrize(
    ("law", "wanted"),
    [
        ("pi", "omega_ref [rad/s] is the reference speed: 0 until you set it, and the motor stands."),
        ("space-speed",
            "omega_ref [rad/s] is the reference speed: 0 until you set it, and the motor stands."),
        ("trial",
            "The motion is given for a whole trial. Set omega_ref [rad/s] to its derivative: the check for "
            "a stuck angle uses it."),
        ("space-position",
            "theta_ref [rad], omega_ref and alpha_ref, its derivatives: 0 until you set them."),
    ],
)  # fmt: skip
def test_which_reference_a_law_reads(subject: Subject, law: str, wanted: str) -> None:
    assert board(changed(subject, law))["reference_comment"] == wanted


def test_what_comes_out_for_a_bridge(subject: Subject) -> None:
    """The current of a short circuit is psi_f / L_d, 68 mWb / 30 mH, if the drive was told the inductance."""
    told = board(subject)
    assert (told["out_words"], told["hold"]) == ("duty cycles", "10 ms")
    assert told["board_act_declaration"] == (
        "void board_set_duty(const cgl_real duty[3]); /* in [0, 1], from the next PWM period on */\n"
        "void board_set_gates(bool on); /* off: all switches open, no current is driven */"
    )
    assert told["what_it_runs"] == (
        "plausibility of the\nmeasurements, the law every 15 calls, the current loop. Duty cycles come out, "
        "for the next PWM period."
    )
    brakes = (
        "all duty cycles are one half. These\nshort-circuit a turning motor, and the current brakes it with "
        "up to psi_f / L_d{}. So open the bridge then (gates off); a bridge that\ncan't be opened needs "
        "`.current_max` above twice this current"
    )
    assert told["safe_output"] == brakes.format(" = 2.27 A")
    each = changed(subject, foc={"L_d": 0.0}, divider=1)
    assert board(each)["safe_output"] == brakes.format("")
    assert board(each)["what_it_runs"].startswith(
        "plausibility of the\nmeasurements, the law, the current loop."
    )


def test_what_comes_out_for_a_current_loop_of_one_s_own(subject: Subject) -> None:
    told = board(changed(subject, foreign=True))
    assert (told["out_words"], told["safe_output"]) == (
        "current references",
        "the current references are zero",
    )
    assert told["board_act"] == "board_set_current(out.i_d_ref, out.i_q_ref);"
    assert told["board_act_declaration"] == (
        "void board_set_current(cgl_real i_d_ref, cgl_real i_q_ref); "
        "/* [A]; references of your current loop */"
    )
    assert told["what_it_runs"] == (
        "plausibility of the\nmeasurements, and the law every 15 calls. The study's current loop is ideal: "
        "`out.i_d_ref` and `out.i_q_ref`\n[A] come out, for a current loop of your own."
    )


def test_what_must_be_measured_of_two_phases_and_of_three(subject: Subject) -> None:
    def rows(**changes: Any) -> list[str]:
        return board(changed(subject, **changes))["measured"].splitlines()

    def angle(forward: str) -> str:
        return (
            "| `theta_m` | rad, mechanical, wrapped to [0, 2 pi). 0 where the d axis, the magnet's north, "
            f"stands on phase a; theta_e = 4 theta_m. It grows when the field turns {forward} |"
        )

    signs = "positive into the motor; positive `i_q` drives forward |"
    three, two = rows(), rows(foc={"phases": 2})
    assert [three[0], *three[2:]] == [
        angle("in the order a, b, c"), f"| `i_abc` | A, of phases a, b and c, {signs}", "| `u_dc` | V |"
    ]  # fmt: skip
    assert [two[0], *two[2:]] == [
        angle("from a towards b"),
        f"| `i_abc[0]`, `i_abc[1]` | A, of phases a and b, {signs}",
        "| `u_dc` | V |",
    ]
    assert rows(foreign=True) == three[:2]


def test_a_map_is_saved_between_trials_or_while_learning_rests(subject: Subject) -> None:
    assert board(subject)["maps"] == ""
    maps = {law: board(replace(changed(subject, law), map=(3, 360)))["maps"] for law in ("pi-ilc", "trial")}
    rests = "set reference.learn = false, wait for a step of the law, save, and set it true again."
    for law, when, motor in (
        ("pi-ilc", f"From the main loop: {rests}", ".motor."),
        ("trial", "Between two trials.", ".motor, .motion."),
    ):
        assert f"/* {when} */\ncgl_map_result save_map(void)" in maps[law]
        assert f".write_size, {motor} A slot takes" in maps[law]
        assert "CGL_MAP_STORED_LENGTH(3, 360, write_size)" in maps[law] and "/* After pi_init," in maps[law]
        assert f"cgl_map_of_{law.replace('-', '_')}(&controller.law, &map)" in maps[law]


def test_what_a_reset_forgets(subject: Subject) -> None:
    assert _reset_comment(subject) == "As after init."
    assert _reset_comment(changed(subject, "anti-cogging")) == "As after init, but the table stays."
    assert _reset_comment(changed(subject, "pi-ilc")) == "As after init: forgets what was learned, too."


def test_a_calibration_and_trials_have_functions_of_their_own(subject: Subject) -> None:
    """Each of them is declared with its comment, and defined without."""
    assert set(extras(subject).values()) == {""}
    table = extras(changed(subject, "anti-cogging"))
    assert table["more_declarations"].endswith("void pi_calibrate(pi_controller *controller);\n")
    assert table["more_definitions"] == (
        "\nvoid pi_calibrate(pi_controller *controller)\n{\n"
        "    cgl_anti_cogging_calibrate(&controller->law);\n}\n"
    )
    assert table["more_rows"].startswith("| calibration | `pi_calibrate` starts it; until then")
    trial = replace(changed(subject, "trial"), law_config={"samples": 250})
    told = extras(trial)
    assert told["more_definitions"] == (
        "\nvoid pi_begin_trial(pi_controller *controller, const cgl_real *y_ref)\n{\n"
        "    cgl_drive_reset(&controller->drive);\n    cgl_trial_begin(&controller->law, y_ref);\n}\n"
        "\nbool pi_end_trial(pi_controller *controller)\n{\n    return cgl_trial_end(&controller->law);\n}\n"
    )
    assert (
        told["more_declarations"].count("/*") == 2
        and "theta_ref at the\n * 250 samples" in told["more_declarations"]
    )
    assert told["more_rows"] == (
        "| a trial | `pi_begin_trial`, then 250 samples, one every 15 steps, then `pi_end_trial` from the "
        "background |\n"
    )
    assert "static const cgl_real motion[250] = {0};" in told["example_declarations"]
    resets = extras(replace(trial, dead_time_config={"time": 1e-6}))["more_definitions"]
    assert "->drive);\n    cgl_dead_time_reset(&controller->dead_time);\n    cgl_trial_begin(" in resets


def test_parts_around_the_drive_have_their_texts_where_the_study_has_them(
    subject: Subject, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The step is followed by the compensation of dead time. The example has the sensor's table."""
    monkeypatch.setattr(
        "cogless.export.c.parts.initialiser", lambda headers, struct, *of: f"    /* {struct} */"
    )
    none = dict.fromkeys(parts(subject), "") | {"actuate": "cgl_drive_actuate(drive, out)"}
    for plain in (subject, replace(subject, encoder_table_config={"cells": 4})):
        assert parts(plain) == none and plain.parts == ["drive.h", "speed_pi.h"]
    dead = replace(subject, dead_time_config={"time": 1e-6})
    assert dead.parts == ["drive.h", "speed_pi.h", "dead_time.h"]
    told = parts(dead)
    assert "cgl_dead_time_step(&controller->dead_time, &drive->currents, out->duty);" in told["compensate"]
    assert told["part_members"] == "    cgl_dead_time dead_time;\n"
    assert "pi_dead_time_config = {\n    /* cgl_dead_time_config */\n};" in told["part_configs"]
    assert told["part_includes"] == '#include "cogless/dead_time.h"\n'
    assert told["part_resets"] == "    cgl_dead_time_reset(&controller->dead_time);\n"
    both = replace(dead, current_reference_config={"mtpa": True})
    assert both.parts == ["drive.h", "speed_pi.h", "current_reference.h", "dead_time.h"]
    texts = parts(both)
    assert texts["actuate"] == ("cgl_current_reference_actuate(&controller->current_reference, drive, out)")
    assert "cgl_current_reference_step(&controller->current_reference, drive);" in texts["convert"]
    assert "&pi_current_reference_config, &controller->drive)" in texts["part_inits"]
    assert texts["part_resets"] == told["part_resets"]


@pytest.mark.parametrize(
    ("unguarded", "kind", "defines", "unused"),
    [
        (False, None, [], set()),
        (True, "CGL_MEMORY_TIME", ["COGLESS_NO_GUARD"], {"guard.c"}),
        (False, "CGL_MEMORY_ANGLE", ["COGLESS_NO_DELAY_LINE"], {"delay_line.c", "delay_line.h"}),
    ],
)
def test_parts_that_a_controller_does_not_use_are_left_out(
    subject: Subject, unguarded: bool, kind: str | None, defines: list[str], unused: set[str]
) -> None:
    law = {"memory": {"kind": kind}} if kind else {"memory": [1.0]}
    less = replace(changed(subject, unguarded=unguarded), law_config=law)
    assert (less.defines, less.unused) == (["COGLESS_NO_TEXTS", *defines], unused)


def test_a_law_that_learns_nothing_has_no_memory(subject: Subject) -> None:
    words = _template_words(subject)
    told = {
        "law_rate": "1000", "learning": "none", "reset_comment": "As after init.", "memory_text": "none",
        "memory_member": "", "memory_define": "", "matrix": "", "verdict_list": "", "verdict_comment": "",
        "flags": "-std=c99 -O2 -ffp-contract=off -DCOGLESS_NO_TEXTS -DCOGLESS_NO_GUARD",
        "defines": ", `-DCOGLESS_NO_TEXTS`, `-DCOGLESS_NO_GUARD`",
        "precision": "single", "title": "A small drive", "law": "pi", "pad": "  ", "stem": "pi_controller",
        "init_call": "cgl_pi_init(&controller->law, &pi_law_config, &controller->drive.loop)",
    }  # fmt: skip
    assert {key: words[key] for key in told} == told


def test_texts_of_a_study_end_no_comment_of_c() -> None:
    assert plain_comment(" a /* b\n */ c") == "a / * b * / c"
    (first, second) = figure_lines([("gain", "word " * 24 + "*/"), ("a", "1")]).rsplit("\n", 1)
    assert second == " * a = 1"
    assert first.splitlines()[0].startswith(" * gain = word word")
    assert (
        first.splitlines()[1:] == [" *     word word word * /"] and max(map(len, first.splitlines())) <= 118
    )
    assert verdict_comment(["settles"]) == " * learning         settles\n" and verdict_comment([]) == ""
    wrapped = verdict_comment(["word " * 25, "*/"]).splitlines()
    assert wrapped[1].startswith(" *                  word") and len(wrapped) == 3
    assert wrapped[2] == " *                  * /"
    assert matrix_array("pi", None, "f") == ""


def test_the_precision_is_checked_by_the_compiler() -> None:
    error = 'the study computes in {} precision: compile every file {} COGLESS_DOUBLE"\n#endif'
    single, double = error.format("single", "without"), error.format("double", "with")
    assert _precision_check(False) == f'#ifdef COGLESS_DOUBLE\n#error "{single}'
    assert _precision_check(True) == f'#ifndef COGLESS_DOUBLE\n#error "{double}'


def test_a_macro_that_is_missing_is_told_by_the_compiler(tmp_path: Path) -> None:
    """Before the law's header includes a file that is left out."""
    macro = "COGLESS_NO_DELAY_LINE"
    header = Template(files("cogless.export").joinpath("assets", "c", "controller.h").read_text())
    (tmp_path / "cogless").mkdir()
    (tmp_path / "cogless" / "drive.h").touch()
    (tmp_path / "it.h").write_text(header.safe_substitute(macro_checks=_left_out_check(macro)))
    run = ["cc", "-fsyntax-only", "-x", "c", "it.h"]
    said = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True).stderr
    wanted = f'#error "this export leaves out files of the library: compile every file with {macro}"'
    assert wanted in said and said.index(wanted) < said.index("law_header")
    given = subprocess.run([*run, f"-D{macro}"], cwd=tmp_path, capture_output=True, text=True).stderr
    assert "#error" not in given


@pytest.mark.parametrize(
    ("divider", "ticks", "repeated"),
    [(1, 9000, 400), (6, 9000, 480), (15, 9000, 1200), (30, 9000, 2000), (15, 70, 70)],
)
def test_a_self_test_lasts_for_80_steps_of_the_law(
    subject: Subject, divider: int, ticks: int, repeated: int
) -> None:
    """At least 400 periods, and at most 2000, or those of the scenario."""
    run: Any = SimpleNamespace(ticks=ticks)
    assert self_test_ticks(changed(subject, divider=divider), run) == repeated


@pytest.mark.parametrize(
    ("study", "scenario", "controller", "phases"),
    [
        ("verrelli2016", "twelve-seconds", "pi", 2),
        ("uomodri", "1-rev-s", "pi", 3),
        ("mandra2019", "table-1", "ilc", 3),
    ],
)
def test_an_fmu_has_a_current_and_a_duty_cycle_for_each_phase(
    study: str, scenario: str, controller: str, phases: int
) -> None:
    run = prepare(load(study), scenario, controller)
    assert run.phases == phases
    names = [variable.name for variable in measurements("input", run.phases, 24.0)]
    assert [name for name in names if ".i_" in name] == [f"measured.i_{phase}" for phase in "abc"[:phases]]
    assert len(duties("output", run.phases)) == phases
