"""What the engine is told of a run of trials: complete conditions of each phase, and the law's gains."""

from math import exp
from pathlib import Path
from typing import Any

import pytest
import trial_studies

from cogless.c_layout import control_layout
from cogless.design.trials.from_study import design_study
from cogless.run.trial_config import engine_config


def described(
    folder: Path, scenario: str, controller: str, text: str, changes: dict[str, Any] | None = None
) -> dict[str, Any]:
    study = trial_studies.loaded(folder, changes, text)
    designs = design_study(study, [(scenario, controller)])
    return engine_config(study, scenario, controller, designs[scenario, controller])


def test_each_phase_of_a_drive_has_all_its_conditions(tmp_path: Path) -> None:
    """From the 5th trial on there is a load, and from the 9th a larger inertia, too."""
    changes = {
        "scenario.move.initial_speed": "3 rad/s",
        "scenario.move.reference": [["0 s", "0.25 rad"], ["0.4 s", "1 rad"]],
    }
    found = described(tmp_path, "move", "feedback", trial_studies.DRIVE, changes)
    trials = found["trials"]
    assert (trials["samples"], trials["count"]) == (200, 12)  # half a second at 400 Hz
    phases = trials["phases"]
    assert [phase["from"] for phase in phases] == [0, 4, 8]
    step = {"sample": 40, "torque": 0.5}
    assert [phase["load_steps"] for phase in phases] == [[], [step], [step]]
    assert [phase["mechanics"]["inertia"] for phase in phases] == [5.9e-4, 5.9e-4, 10.6e-4]
    assert [phase["motor"]["psi_f"] for phase in phases] == pytest.approx([0.37 / 4.5] * 3)
    for phase in phases:
        assert (len(phase["reference"]), phase["reference"][-1]) == (200, 1.0)
        assert (phase["initial_angle"], phase["initial_speed"]) == (0.25, 3.0)  # where the reference begins
    control = control_layout("single").decode("cgl_drive_config", found["drive"]["control"])
    # a drive between trials neither stops learning at its limit nor guards it
    assert (control["divider"], control["learn_saturated"], control["unguarded"]) == (20, True, True)


@pytest.mark.parametrize("angle", ["0 rad", "0.5 rad"])
def test_an_angle_that_is_given_is_where_a_trial_begins(tmp_path: Path, angle: str) -> None:
    changes = {
        "scenario.move.initial_angle": angle,
        "scenario.move.reference": [["0 s", "0.25 rad"], ["0.4 s", "1 rad"]],
    }
    found = described(tmp_path, "move", "feedback", trial_studies.DRIVE, changes)
    wanted = float(angle.split()[0])
    assert [phase["initial_angle"] for phase in found["trials"]["phases"]] == [wanted] * 3


def test_each_phase_of_a_plant_is_sampled_exactly(tmp_path: Path) -> None:
    """x1' = -a·x1 + k·u, x2' = x1 - 2a·x2 over a tenth of a second; a = 0.75, and 0.8 from the 4th trial."""
    found = described(tmp_path, "cycle", "ilc", trial_studies.LINEAR)
    assert (found["C"], found["period"], found["samples"], found["count"]) == ([0, 1], 0.1, 50, 6)
    assert [phase["from"] for phase in found["phases"]] == [0, 3]
    for phase, a in zip(found["phases"], (0.75, 0.8), strict=True):
        one, two = exp(-0.1 * a), exp(-0.2 * a)
        assert phase["A"][0] == pytest.approx([one, 0.0])
        assert phase["A"][1] == pytest.approx([(one - two) / a, two])
        held = (1 - one) / a, (1 - two) / (2 * a)
        assert phase["B"] == pytest.approx([2.0 * held[0], 2.0 * (held[0] - held[1]) / a])
        assert phase["load"] == [0.0] * 10 + [0.1] * 40
        assert phase["initial_state"] == [0.0, 0.0]


@pytest.mark.parametrize("filtered", ["error", "signal"])
def test_a_law_of_trials_is_told_its_limits_and_its_filter(tmp_path: Path, filtered: str) -> None:
    q_filter = {"cutoff": "30 Hz", "acts_on": filtered}
    changes = {"controller.ilc.learned_limit": 6, "controller.ilc.q_filter": q_filter}
    config = described(tmp_path, "move", "ilc", trial_studies.DRIVE, changes)["controller"]["config"]
    found = control_layout("single").decode("cgl_trial_config", config)
    assert (found["samples"], found["states"]) == (200, 2)
    assert (found["limit"], found["learned_limit"]) == (10.0, 6.0)  # the drive's, and the law's own
    assert found["filter_signal"] == (filtered == "signal")
    q = found["q_filter"]
    assert q["order"] == 2 and q["b"][3:] == q["a"][3:] == [0.0, 0.0]
    assert sum(q["b"]) == pytest.approx(sum(q["a"]), rel=1e-4)  # a gain of one at rest
    assert q["b"][0] - q["b"][1] + q["b"][2] == pytest.approx(0.0, abs=1e-6)  # and of zero at half the rate
