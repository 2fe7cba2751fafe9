"""`cogless live`, `cogless run --live` and what they refuse."""

import live_studies
import pytest
from commands import cogless
from node import NO_ENGINE

needs = pytest.mark.skipif(bool(NO_ENGINE), reason=NO_ENGINE)


@needs
def test_the_page_is_written_where_it_is_asked_for(capsys, tmp_path):
    study = live_studies.study(tmp_path).source.path
    code, out, _ = cogless(capsys, "live", study, "-o", tmp_path / "page.html")
    assert (code, out) == (0, f"Page: {tmp_path / 'page.html'}\n")
    assert f"cogless run {study}" in (tmp_path / "page.html").read_text(encoding="utf-8")


@needs
def test_a_run_writes_the_page_beside_its_report(capsys, tmp_path):
    study, folder = live_studies.study(tmp_path).source.path, tmp_path / "out"
    code, out, _ = cogless(capsys, "run", study, "--only", "step/pi", "--live", "-o", folder)
    assert code == 0 and f"Page: {folder / 'live.html'}" in out
    assert {"report.html", "live.html", "results.json"} <= {path.name for path in folder.iterdir()}


@needs
def test_a_law_that_the_page_leaves_out_is_named(capsys, tmp_path):
    (tmp_path / "law.py").write_text("class Zero:\n    def step(self, i):\n        return 0.0\n")
    study = live_studies.study(tmp_path).source.path
    text = study.read_text(encoding="utf-8")
    study.write_text(text + '[controller.mine]\nlaw = "python"\nobject = "law.py:Zero"\nlabel = "Mine"\n')
    code, _, error = cogless(capsys, "live", study, "-o", tmp_path / "page.html")
    assert code == 0
    line = "Left out of the page: Mine: its law is code of its own, which the page doesn't run."
    assert error.splitlines() == [line]
    code, _, error = cogless(capsys, "run", study, "--only", "step/pi", "--live", "-o", tmp_path / "out")
    assert code == 0 and line in error


@needs
def test_a_page_of_ones_own_motor_needs_it_in_a_datasheets_words(capsys, tmp_path):
    study = live_studies.study(tmp_path).source.path
    code, _, error = cogless(capsys, "live", study, "--own-motor", "-o", tmp_path / "page.html")
    told = "live: motor.inductance_line_to_line: missing: expected for the fields of one's own motor\n"
    assert (code, error) == (2, told) and not (tmp_path / "page.html").exists()
