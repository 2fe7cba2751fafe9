"""What the guide on studies of trials says of its example is so."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cogless import load, run_study
from cogless.cli import app
from cogless.design.trials.trial_summary import summary
from cogless.report import outcome
from cogless.study import TrialStudy

GUIDE = (Path(__file__).parents[2] / "docs" / "guide" / "trial-studies.md").read_text(encoding="utf-8")
PROSE = " ".join(GUIDE.split())  # wherever its lines end
TRIALS = r"trial (\d+) of the first phase, trial (\d+) of the second and trial (\d+) of the third"


@pytest.fixture
def axis(tmp_path: Path) -> Path:
    block = re.search(r"```toml\n(title.*?)```", GUIDE, re.DOTALL)
    assert block is not None
    (tmp_path / "axis.toml").write_text(block[1], encoding="utf-8")
    return tmp_path / "axis.toml"


def test_the_example_learns_as_the_guide_says(axis: Path) -> None:
    study = load(axis)
    assert isinstance(study, TrialStudy)
    certificate = summary(study).designs["ilc"].certificate
    assert certificate.exact is not None
    told = re.search(r"For the controller `ilc` the bound is (\S+) with the filter", PROSE)
    assert told is not None
    model = certificate.exact
    assert model.with_filter is not None and model.with_filter.contracting
    assert float(told[1]) == pytest.approx(model.with_filter.norm, abs=0.001)
    assert model.without_filter is not None and not model.without_filter.monotone
    feedback, ilc = run_study(study).runs
    told = re.search(rf"reaches the floor in {TRIALS}", PROSE)
    assert told is not None
    assert [float(n) for n in told.groups()] == ilc.metrics["trials_to_floor"]
    found = feedback.metrics["trials_to_floor"]
    assert isinstance(found, list) and found[1:] == [float("inf")] * 2


def test_the_drive_learns_as_the_guide_says() -> None:
    study = load(Path(__file__).parents[2] / "examples" / "repeated_motion.toml")
    feedback, ilc = run_study(study).runs
    trials = re.search(rf"below 1 mrad in {TRIALS}", PROSE)
    share = re.search(r"may leave ([\d.]+) times the error of feedback alone", PROSE)
    assert trials is not None and share is not None
    assert [float(n) for n in trials.groups()] == ilc.metrics["trials_to_floor"]
    alone = feedback.metrics["trials_to_floor"]
    assert isinstance(alone, list) and alone[1:] == [float("inf")] * 2
    assert isinstance(study, TrialStudy)
    design = summary(study).designs["ilc"]
    assert not design.certified and design.prediction is not None
    assert float(share[1]) == pytest.approx(design.prediction.share, abs=0.005)
    assert design.prediction.worst_phase == 0


# For each change: the line of the error; ... stands for a number.
ERRORS = [
    (
        "controller.ilc.q_filter.acts_on=error",
        "controller.ilc.q_filter: no K_3 makes the error fall at every frequency: above ... times the "
        "sampling rate it grows with any gain, because the feedback lags too much there; "
        "expected a zero-phase low-pass filter on the learned signal, and a "
        'shift that suits it; q_filter = "auto" and shift = "auto" would choose a filter of ... Hz and a '
        "shift of ...",
    ),
    (
        "plant.parameter.J.range=[1e-6,1e-2]",
        "plant.parameter: expected ranges that one gain and one Lyapunov matrix can control; no "
        "gain controls both J = 1e-06, B = 0.002 and J = 0.01, B = 0.001; one gain controls the "
        "ranges if they are shrunk to ... % of their width",
    ),
    (
        'plant.A=[[0,1],[0,"-B/Jm"]]',
        'plant.A.1.1: "-B/Jm": expected only known parameters (J, B, K_t), not "Jm"',
    ),
    (
        "controller.ilc.K_s=[-1000,-0.1,1]",
        "controller.ilc.K_s: expected feedback that is stable at J = 0.0004, B = 0.001; its "
        "largest pole is 1.961",
    ),
]


@pytest.mark.parametrize(("change", "line"), ERRORS)
def test_a_controller_that_cannot_be_designed_says_why(axis: Path, change: str, line: str) -> None:
    out = str(axis.parent / "out")
    command = ["run", str(axis), "-o", out, "--only", "*/ilc", "--set", change]
    found = CliRunner().invoke(app, command)
    assert found.exception is not None
    told = "[0-9.e-]+".join(re.escape(part) for part in line.split("..."))
    assert re.fullmatch(re.escape(f"{axis}: ") + told, str(found.exception))


def test_the_commands_of_the_example_end_well(axis: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each line below the study: design, run, live and export."""
    monkeypatch.chdir(axis.parent)
    lines = re.findall(r"^    cogless (\w+ axis\.toml[^#\n]*)", GUIDE, re.MULTILINE)
    assert [line.split()[0] for line in lines[:4]] == ["design", "run", "live", "export"]
    for line in dict.fromkeys(line.strip() for line in lines if not line.startswith("live")):
        found = CliRunner().invoke(app, line.split())
        assert found.exit_code == 0, (line, found.exception)
    assert (axis.parent / "axis-c" / "ilc_controller.c").is_file()


def test_the_terminal_has_the_columns_of_the_guide(axis: Path) -> None:
    results = run_study(load(axis))
    found = outcome(results, "move")
    assert found is not None
    columns = re.findall(r"^\| ([a-z1 ()]+) \|", GUIDE[GUIDE.index("## On the terminal") :], re.MULTILINE)
    shown = [" ".join(column.split()) for column in found.columns]
    assert columns[1:7] == [*shown[:4], f"current ({shown[4]})", shown[5]]


def test_noise_is_amplified_as_the_theory_says(axis: Path) -> None:
    theory = (Path(__file__).parents[2] / "docs" / "theory" / "trial-design.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.*) \| ([\d.]+) \| ([\d.]+) \|$", theory, re.MULTILINE)
    laws = (
        {},
        {"controller.ilc": {"law": "norm-optimal"}},
        {"controller.ilc": {"law": "norm-optimal", "change_weight": 1.0}},
        {"controller.ilc": {"law": "observer-ilc"}},
    )
    for (about, *told), law in zip(rows, laws, strict=True):
        study = load(axis, law)
        assert isinstance(study, TrialStudy)
        assert study.controller["ilc"].law in about or about == "`ilc` of the guide"
        found = summary(study).designs["ilc"].amplification
        assert found is not None
        assert [float(x) for x in told] == pytest.approx([max(found.load), max(found.noise)], abs=0.01)
