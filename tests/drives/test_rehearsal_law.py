"""The rehearsal of a plan with the drive's own law in the loop."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from commands import cogless
from drives.clocked_drive import STUDY
from drives.moteus_stand_in import GAINS, TURN, Moteus

from cogless.identify import rehearsal
from cogless.run.simulate import rollout


def test_the_rehearsal_has_the_drives_law_where_its_gains_are_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The dump has moteus's gains; without it the study's PI is in the loop, and no other law is named."""
    laws: list[dict[str, Any]] = []

    def played(studies: list[Any]) -> Any:
        laws.append({name: law.params for name, law in studies[0].controller.items() if law.code})
        return rollout(studies)

    monkeypatch.setattr(rehearsal, "rollout", played)
    study = tmp_path / "gimbal.toml"
    study.write_text(STUDY)
    dump = Moteus().dump(tmp_path / "dump.cfg")
    for number, options in enumerate((["--drive-config", dump], [])):
        command = ["identify", "--plan", study, "--drive", "moteus", *options, "-o", tmp_path / f"{number}"]
        code, out, err = cogless(capsys, *command)
        assert code == 0, err
        assert ("under moteus's own law with the gains of" in out) == bool(options)
        assert "inertia over K_t" in out and "cogging, order 84" in out
    assert list(laws[0]) == ["moteus"] and not laws[1]
    gains = dict(zip(("kp", "kd", "ki"), (TURN * gain for gain in GAINS), strict=True))
    assert {key: laws[0]["moteus"][key] for key in gains} == pytest.approx(gains)
