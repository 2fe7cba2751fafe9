"""One chain of commands: plan, simulate, identify, run; and the real motor's logs."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest
from identify.commissioned import study_text
from PIL import Image

from cogless import load, run_study
from cogless.__main__ import main
from cogless.maps import stored_map

DATA = Path(__file__).parents[3] / "shared" / "data" / "laas_anti_cogging"


def cogless(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """A command as a user gives it, without starting Python anew."""
    before, argv = Path.cwd(), sys.argv
    out, error = io.StringIO(), io.StringIO()
    os.chdir(cwd)
    sys.argv = ["cogless", *arguments]
    try:
        with redirect_stdout(out), redirect_stderr(error), pytest.raises(SystemExit) as end:
            main()
    finally:
        os.chdir(before)
        sys.argv = argv
    code = end.value.code
    return subprocess.CompletedProcess(arguments, int(code or 0), out.getvalue(), error.getvalue())


@pytest.fixture(scope="module")
def chain(tmp_path_factory) -> Path:
    """A folder after plan, run and identify of the gimbal."""
    folder = tmp_path_factory.mktemp("chain")
    (folder / "motor.toml").write_text(study_text("gimbal"))
    for command in (
        ["identify", "--plan", "motor.toml", "-o", "plan"],
        ["run", "plan/study.toml", "-o", "logs"],
        ["identify", "logs/traces.nc", "--config", "plan/id.toml", "-o", "found", "--plots"],
    ):
        done = cogless(*command, cwd=folder)
        assert done.returncode == 0, done.stderr
        (folder / f"{command[command.index('-o') + 1]}.txt").write_text(done.stdout)
    return folder


def test_the_found_motor_ripples_as_the_true_one(chain):
    """Speed ripple at one speed of the planned sequence, of the motor that was found and of the true one."""

    def ripple(study: str) -> float:
        (run,) = run_study(load(chain / study), ["one-speed/pi"]).runs
        return float(np.std(run.trace["omega_m"][run.trace.window(2.0, 3.9)]))

    assert ripple("found/study.toml") == pytest.approx(ripple("plan/study.toml"), rel=0.05)


def test_the_plan_says_which_errors_to_expect(chain):
    """They are those that come out then, of the same motor; simulating the logs makes some smaller."""

    def error(file: str) -> float:
        line = next(line for line in (chain / file).read_text().splitlines() if line.startswith("inertia"))
        return float(line.split("+-")[1].split()[0])

    assert 0.2 * error("found.txt") < error("plan.txt") < 4 * error("found.txt")


def test_each_command_ends_with_the_files_that_it_wrote_and_the_next_command(chain):
    """The next commands are those of `chain` and of the test below."""
    ends = {
        "plan": ("Columns: plan/id.toml\nRecord: ", "Next: cogless identify --config plan/id.toml LOG..."),
        "found": ("Report: found/report.html\nNext: ", "Next: cogless run found/study.toml"),
    }
    for folder, (files, end) in ends.items():
        said = (chain / f"{folder}.txt").read_text()
        assert f"Study: {folder}/study.toml\n{files}" in said and said.endswith(f"\n{end}\n")


def test_the_found_study_runs(chain):
    done = cogless("run", "found/study.toml", "--only", "fast/*", "-o", "again", cwd=chain)
    assert done.returncode == 0, done.stderr
    assert (chain / "again/report.html").is_file()


def test_the_picture_has_a_bar_and_an_error_for_each_order(chain):
    found = json.loads((chain / "found/identified.json").read_text())
    waves = [wave for kind in ("cogging", "torque_constant_ripple", "encoder") for wave in found[kind]]
    with Image.open(chain / "found/orders.png") as image:
        series = json.loads(image.info["Series"])
    assert len(series) == 2 * len(waves)
    low, high = series[0]  # of the first order of cogging, mN m
    assert (low + high) / 2 == pytest.approx(1e3 * waves[0]["amplitude_N_m"], rel=1e-3)
    assert (high - low) / 2 == pytest.approx(1e3 * waves[0]["amplitude_error"], abs=1e-3)


def test_values_have_errors_and_sources(chain):
    found = json.loads((chain / "found/identified.json").read_text())
    inertia = found["values"]["j"]
    assert inertia["value"] * found["K_t_N_m_per_A"] == pytest.approx(8e-5, rel=0.01)
    assert 0 < inertia["error"] < 0.02 * inertia["value"]
    assert {wave["order"] for wave in found["cogging"]} == {12, 42, 84}
    text = (chain / "found/motor.toml").read_text()
    size = re.search(r"# cogging, order 42: ([\d.]+) \+- ", text)
    assert size and float(size.group(1)) == pytest.approx(6, rel=0.01)
    assert "+-" in text
    assert "from slow, one-speed, fast" in text


def test_the_table_cancels_the_cogging(chain):
    newest = stored_map.newest(stored_map.read(chain / "found/cogging.bin"))
    assert newest is not None
    assert newest.map.law_name == "anti-cogging"
    angle, current = newest.map.angle, newest.map.values[0]
    cogging = sum(
        torque * np.sin(order * angle + np.radians(phase))
        for order, torque, phase in ((42, 6e-3, 30), (12, 2e-3, -70), (84, 0.8e-3, 120))
    )
    assert np.std(0.08 * current + cogging) < 0.02 * np.std(cogging)
    assert (chain / "found/cogging.csv").read_text().startswith("theta_m_rad,current_A\n")


def test_the_report_says_what_was_found(chain):
    page = (chain / "found/report.html").read_text()
    for text in (
        "inertia over K_t",
        "Measured and simulated",
        "load-backwards",
        "predicted from the other logs",
    ):
        assert text in page
    found = json.loads((chain / "found/identified.json").read_text())
    kinds = {"cogging": "Cogging", "torque_constant_ripple": "K_t ripple",
             "encoder": "Encoder&#x27;s error"}  # fmt: skip
    for kind, title in kinds.items():
        drawn = re.findall(rf"<h3>{title} by mechanical order.*?</table>", page, re.DOTALL)
        orders = re.findall(r'<tr><th>(\d+)</th><td class="wide">', "".join(drawn))
        assert orders == [str(wave["order"]) for wave in found[kind]], title
    assert "src=" not in page and "href=" not in page  # works offline
    ratios = re.findall(r"one-speed: 1 s of (?:omega|i_q) \(.*? simulated / measured: ([\d.]+|nan)", page)
    assert len(ratios) == 4  # of speed and current, each in the heading and in the picture's label
    assert all(0.9 < float(ratio) < 1.1 for ratio in ratios)


def test_mistakes_on_the_command_line_are_told(tmp_path):
    for arguments, message in (
        (
            ["identify"],
            "identify: expected logs with --config FILE or --drive NAME, or --plan STUDY without logs",
        ),
        (
            ["identify", "--plan"],
            "Option '--plan' requires an argument: expected --plan STUDY. See cogless id",
        ),
        (["identify", "a.csv", "--plan", "uomodri"], "identify: --plan uomodri: expected neither logs"),
        (["identify", "a.csv", "--config", "no.toml"], "no.toml: no such file: expected a TOML file"),
    ):
        done = cogless(*arguments, cwd=tmp_path)
        assert done.returncode == 2
        assert done.stderr.startswith(message)
        assert not (tmp_path / "results").exists()


@pytest.mark.skipif(not DATA.is_dir(), reason="the measured logs of the LAAS board are not beside this clone")
def test_the_real_motors_hold_map(tmp_path):
    """The values of motors/uomodri.toml, and what one speed under a feedback law cannot tell."""
    done = cogless(
        "identify",
        str(DATA / "static_holding_current.csv"),
        str(DATA / "speed_test1_500Hz.csv.gz"),
        *("--config", str(Path(__file__).parents[2] / "examples" / "uomodri_logs.toml")),
        *("-o", "found"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "found/identified.json").read_text())
    assert found["values"]["c_hold"]["value"] == pytest.approx(0.0529, rel=0.02)
    by_order = {wave["order"]: wave for wave in found["cogging"]}
    assert by_order[72]["amplitude_N_m"] / found["K_t_N_m_per_A"] == pytest.approx(0.1844, rel=0.01)
    assert np.degrees(by_order[72]["phase_rad"]) == pytest.approx(40.5, abs=1.5)
    assert "j" not in found["values"]
    assert 12 not in by_order
    assert any(line.startswith("The logs have only one speed") for line in found["left_out"])
    _, missing = done.stdout.split("\n\nNot in these logs:\n")
    assert missing.startswith("! ") and "\n! The logs have only one speed" in f"\n{missing}"
    assert done.stdout.endswith("Next: cogless identify --plan STUDY, which says what to record\n")


def test_a_motor_on_hall_sensors_has_no_plan(tmp_path):
    done = cogless("identify", "--plan", "hub-motor", "-o", "plan", cwd=tmp_path)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "drive.position_sensor: Hall sensors show six angles of an electrical revolution" in done.stderr
    assert not (tmp_path / "plan").exists()
