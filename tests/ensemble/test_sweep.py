"""A sweep gives the same table however it is run, and whatever happens on the way."""

import json
import os
import random
import signal
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import ensembles
import numpy as np
import pytest
from commands import cogless, forked
from killed import kills

import studies
from cogless.ensemble import sweep as sweeping
from cogless.ensemble import sweep_table
from cogless.ensemble import workers as executing
from cogless.ensemble.workers import pack, unpacked
from cogless.errors import StudyError
from cogless.files import versions
from cogless.maps.stored_map import StoredMap
from cogless.run import carry_out
from cogless.run.simulate import RunDefect, run_study
from cogless.study import changed

pq = pytest.importorskip("pyarrow.parquet", reason="needs the extra cogless[sweep]")
COUNT = 40  # three chunks, the last shorter


class Here(Executor):
    """Runs tasks at once in this thread."""

    def submit(self, work: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(work(*arguments, **named))
        except Exception as error:
            future.set_exception(error)
        return future


class Dies(Here):
    """Its worker dies at these tasks, counted from 0."""

    def __init__(self, *at: int) -> None:
        self.at, self.count = at, 0

    def submit(self, work: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        self.count += 1
        if self.count - 1 in self.at:
            future: Future[Any] = Future()
            future.set_exception(BrokenProcessPool("died"))
            return future
        return super().submit(work, *arguments, **named)


def plan(folder: Path, count: int = COUNT, **options: Any) -> sweeping.Plan:
    return sweeping.plan(ensembles.study(folder, **options), count)


def content(sweep: sweep_table.Sweep | None, folder: Path) -> bytes:
    assert sweep is not None
    sweep_table.write(sweep, folder / "sweep.parquet")
    return (folder / "sweep.parquet").read_bytes()


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("expected")
    return content(sweeping.run(plan(folder), folder, Here()), folder)


def test_a_row_is_what_the_variant_gives_alone(tmp_path: Path, expected: bytes) -> None:
    (tmp_path / "sweep.parquet").write_bytes(expected)
    found, study = pq.read_table(tmp_path / "sweep.parquet").to_pylist(), ensembles.study(tmp_path)
    assert len(found) == 2 * COUNT
    assert [(row["variant"], row["controller"]) for row in found[:3]] == [(0, "pi"), (0, "pi-ilc"), (1, "pi")]
    row = found[35]
    assert list(row) == [
        "variant", "scenario", "controller", "mechanics.inertia", "mechanics.viscous_friction",
        "ripple_rad_s", "speed_rad_s.24", "speed_rad_s.48", "error",
    ]  # fmt: skip
    settings = {key: f"{row[key]!r} {unit}" for key, unit in (
        ("mechanics.inertia", "kg*m^2"), ("mechanics.viscous_friction", "N*m*s/rad")
    )}  # fmt: skip
    settings = {f'scenario.low.override."{key}"': value for key, value in settings.items()}
    alone = run_study(changed(study, settings), ["low/pi-ilc"]).runs[0].metrics
    assert row["ripple_rad_s"] == alone["ripple_rad_s"]
    assert [row["speed_rad_s.24"], row["speed_rad_s.48"]] == alone["speed_rad_s"]


def test_a_table_says_what_it_is_of(tmp_path: Path, expected: bytes) -> None:
    (tmp_path / "sweep.parquet").write_bytes(expected)
    found = pq.read_table(tmp_path / "sweep.parquet")
    about = {"study": "study", "title": "A small ensemble", "seed": 5, "cogless": versions()["cogless"]}
    assert json.loads(found.schema.metadata[b"cogless"]) == about
    keys = ["mechanics.inertia", "mechanics.viscous_friction"]
    metrics = ["ripple_rad_s", "speed_rad_s.24", "speed_rad_s.48"]
    assert found.column_names == ["variant", "scenario", "controller", *keys, *metrics, "error"]
    assert found["variant"].to_pylist() == [variant for variant in range(COUNT) for _ in range(2)]
    assert found["scenario"].to_pylist() == ["low"] * 2 * COUNT
    assert found["controller"].to_pylist() == ["pi", "pi-ilc"] * COUNT
    assert found["error"].to_pylist() == [None] * 2 * COUNT


def test_parcels_are_the_same_if_the_study_and_its_files_are(tmp_path: Path) -> None:
    (tmp_path / "law.py").write_text(FRAGILE)
    own = '[controller.own]\nlaw = "python"\nobject = "law.py:Law"\nparams = { gain = 0.5 }\n'
    study = ensembles.study(tmp_path, vary=own)
    first, again, other = pack(study), pack(study), pack(changed(study, {"seed": 6}))
    assert first == again and hash(first) == hash(again) and first != other and first != "first"
    (tmp_path / "law.py").write_text(FRAGILE + "\n")
    assert pack(study) != first


def test_threads_and_processes_give_the_same_table(tmp_path: Path, expected: bytes) -> None:
    for name, executor in (("threads", ThreadPoolExecutor(2)), ("processes", ProcessPoolExecutor(2))):
        folder = tmp_path / name
        folder.mkdir()
        with executor:
            assert content(sweeping.run(plan(tmp_path), folder, executor), folder) == expected


def test_shards_merged_in_any_order_give_the_same_table(tmp_path: Path, expected: bytes) -> None:
    planned = plan(tmp_path)
    for index in (4, 0, 2, 1, 3):  # five shards of three chunks: two have nothing to do
        assert sweeping.run(planned, tmp_path, Here(), sweeping.Shard(index, 5)) is None
    assert content(sweeping.merge(planned, tmp_path), tmp_path) == expected


def test_a_sweep_goes_on_where_it_ended(tmp_path: Path, expected: bytes) -> None:
    class Full(Exception):  # noqa: N818
        pass

    def stop(done: int) -> None:
        if done >= 16:
            raise Full

    with pytest.raises(Full):
        sweeping.run(plan(tmp_path), tmp_path, Here(), progress=stop)
    file = tmp_path / "journal.jsonl"
    whole = file.read_bytes()
    assert whole.count(b"\n") == 2  # what it is, and one chunk
    file.write_bytes(whole + b"[1,[[[0.5")  # a line that a kill cut off
    told: list[int] = []
    found = sweeping.run(plan(tmp_path), tmp_path, Here(), progress=told.append)
    assert told[0] == 16 and told[-1] == COUNT
    assert content(found, tmp_path) == expected


def test_a_larger_sweep_goes_on_from_a_smaller_one(tmp_path: Path, expected: bytes) -> None:
    sweeping.run(plan(tmp_path, 20), tmp_path, Here())
    told: list[int] = []
    assert content(sweeping.run(plan(tmp_path), tmp_path, Here(), progress=told.append), tmp_path) == expected
    assert told[0] == 16  # the chunk that was cut off at 20 is run again
    smaller = sweeping.run(plan(tmp_path, 20), tmp_path, Dies(0))
    assert smaller is not None and smaller.values.shape[0] == 20


def test_a_worker_that_dies_costs_its_chunk_only(tmp_path: Path, expected: bytes) -> None:
    executor = Dies(1, 3)
    assert content(sweeping.run(plan(tmp_path), tmp_path, executor), tmp_path) == expected
    assert executor.count == 5


def test_a_task_that_kills_every_worker_is_given_up(tmp_path: Path) -> None:
    with pytest.raises(
        StudyError, match=r"^chunk \d: its worker process died 3 times: expected enough memory for it$"
    ):
        sweeping.run(plan(tmp_path), tmp_path, Dies(*range(99)))


OWN = """[controller.own]
law = "python"
object = "law.py:Law"
"""


@pytest.mark.parametrize(
    ("call", "said"), [("os.kill(os.getpid(), 9)", "died"), ("os._exit(0)", "calls exit(0)")]
)
def test_a_law_that_ends_its_process_is_named(tmp_path: Path, call: str, said: str) -> None:
    """Where that can be prevented, its runs fail and the others are kept."""
    law = f"import os\n\nclass Law:\n    def step(self, inputs):\n        {call}\n"
    (tmp_path / "law.py").write_text(law)
    study = ensembles.study(tmp_path, None, OWN + ensembles.VARY)
    planned = sweeping.plan(study, 2, ["low/pi", "low/own"])
    with executing.processes(1) as workers:
        if said == "died":
            with pytest.raises(StudyError) as error:
                sweeping.run(planned, tmp_path, workers)
            why = f"expected controller.own not to end the process ({tmp_path / 'law.py'}), or enough memory"
            assert str(error.value) == f"chunk 0: its worker process died 3 times: {why}"
        else:
            swept = sweeping.run(planned, tmp_path, workers)
            assert swept is not None and set(swept.errors) == {(0, 1), (1, 1)}
            assert all(text.endswith("law.py line 5: calls exit(0)") for text in swept.errors.values())


class KilledWorker(Exception):  # noqa: N818, as Dask names it
    """What Dask says of a task whose workers died."""


def test_a_task_whose_dask_worker_died_is_sent_again() -> None:
    def dies_twice(number: int) -> int:
        sent.append(number)
        if sent.count(1) < 3 and number == 1:
            raise KilledWorker
        return 7 * number

    sent: list[int] = []
    found: dict[int, int] = {}
    tasks = {number: (number,) for number in (1, 2)}
    here = executing.executor_workers(Here())
    executing.run_all(here, dies_twice, tasks, tasks.__getitem__, found.__setitem__)
    assert found == {1: 7, 2: 14} and sent.count(1) == 3


def test_a_task_that_fails_of_itself_is_not_sent_again() -> None:
    sent: list[int] = []

    def fails() -> None:
        sent.append(1)
        raise ValueError("mine")

    with pytest.raises(ValueError, match=r"^mine$"):
        here = executing.executor_workers(Here())
        executing.run_all(here, fails, [0], lambda number: (), lambda number, result: None)
    assert sent == [1]


def test_a_cluster_that_is_gone_is_told() -> None:
    class Gone(Here):
        def submit(self, work: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
            future: Future[Any] = Future()
            future.cancel()
            future.set_running_or_notify_cancel()  # so that whoever waits for it sees it
            return future

    with pytest.raises(
        StudyError, match=r"^the cluster is gone: the same command, repeated, continues from here$"
    ):
        gone = executing.executor_workers(Gone())
        executing.run_all(gone, int, [0], lambda number: (), lambda number, result: None)


HERE = versions()["cogless"]


@pytest.mark.parametrize(
    ("there", "said"),
    [
        ({}, "tcp://a:1: the cluster has no worker: expected one or more"),
        ({"tcp://b:1": HERE, "tcp://b:2": "0.0.1"},
            f"worker tcp://b:2: has cogless 0.0.1: expected {HERE}, the version of this command"),
        ({"tcp://b:1": ModuleNotFoundError()},
            f"worker tcp://b:1: has no cogless: expected {HERE}, the version of this command"),
    ],
)  # fmt: skip
def test_every_worker_of_a_cluster_has_this_version(there: dict[str, Any], said: str) -> None:
    class Client:
        """A cluster's, whose workers answer so."""

        def __init__(self, answers: dict[str, Any]) -> None:
            self.answers = answers

        def run(self, _: Any, on_error: str) -> dict[str, Any]:
            assert on_error == "return"
            return self.answers

    with pytest.raises(StudyError) as told:
        executing._check_versions("tcp://a:1", Client(there))
    assert str(told.value) == f"--dask: {said}"
    executing._check_versions("tcp://a:1", Client({"tcp://b:1": HERE}))


def test_a_killed_process_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()  # processes as users get them
    found: dict[int, int] = {}
    tasks: dict[int, tuple[Any, ...]] = {n: (str(tmp_path / "marker"),) for n in range(3)}
    with executing.processes(1) as workers:
        executing.run_all(workers, kills, tasks, tasks.__getitem__, found.__setitem__)
    assert found == {0: 7, 1: 7, 2: 7}


def test_a_sweep_that_loses_a_process_gives_the_same_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, expected: bytes
) -> None:
    monkeypatch.undo()  # processes as users get them
    with executing.processes(2) as workers:

        def kill(done: int) -> None:
            if done == 16:  # two chunks are left
                victims.extend(workers.executor._processes.values())  # type: ignore[attr-defined]
                victims[0].kill()

        victims: list[Any] = []
        swept = sweeping.run(plan(tmp_path), tmp_path, workers, progress=kill)
        assert victims[0].exitcode == -signal.SIGKILL
        assert not set(victims) & set(workers.executor._processes.values())  # type: ignore[attr-defined]
    assert content(swept, tmp_path) == expected


def test_a_failed_variant_is_kept_with_its_error(tmp_path: Path) -> None:
    vary = '[vary]\nmechanics.inertia = { log = ["1e-8 kg*m^2", "1e-3 kg*m^2"] }'
    study = ensembles.study(tmp_path, {"mechanics.viscous_friction": "1e-4 N*m*s/rad"}, vary)
    found = sweeping.run(sweeping.plan(study, 16), tmp_path, Here())
    assert found is not None
    bad = {variant for variant, _ in found.errors}
    assert 0 < len(bad) < 16 and len(found.errors) == 2 * len(bad)
    for (variant, place), text in found.errors.items():
        with pytest.raises(StudyError) as error:
            changed(study, found.ensemble.changes(variant))
        assert text == str(error.value).replace(str(tmp_path / "study.toml"), "study.toml")
        assert np.all(np.isnan(found.values[variant, place]))
    assert np.all(np.isfinite(found.values[[v for v in range(16) if v not in bad], :, 0]))


FRAGILE = """
class Law:
    def __init__(self, gain):
        self.gain = gain

    def step(self, inputs):
        from math import nan
        return nan if self.gain > 1 else 0.01 * (inputs.omega_ref - inputs.omega_m)
"""


def test_a_run_that_fails_has_its_own_error(tmp_path: Path) -> None:
    (tmp_path / "law.py").write_text(FRAGILE)
    vary = '[controller.own]\nlaw = "python"\nobject = "law.py:Law"\nparams = { gain = 0.5 }\n'
    vary += "[vary]\ncontroller.own.params.gain = { list = [0.5, 2.0] }"
    found = sweeping.run(sweeping.plan(ensembles.study(tmp_path, vary=vary), 8), tmp_path, Here())
    assert found is not None
    gains = found.ensemble.drawn["controller.own.params.gain"]
    assert {variant for variant, _ in found.errors} == {v for v in range(8) if gains[v] > 1}
    assert {place for _, place in found.errors} == {2}  # the others of the variant are kept
    assert all(text.startswith("study.toml: controller.own: scenario low") for text in found.errors.values())


REFUSES = """
class Law:
    def __init__(self, gain):
        if gain > 1:
            raise ValueError("too much")

    def step(self, inputs):
        return 0.0
"""
WITH_GAIN = OWN + "params = { gain = 0.5 }\n"


def rows_without(study: Any, folder: Path) -> dict[str, Any]:
    """The rows of the same sweep without the controller `own`."""
    found = sweeping.run(sweeping.plan(study, 17, ["low/pi", "low/pi-ilc"]), folder, Here())
    assert found is not None and not found.errors
    return {"/".join(pair): found.values[:, place] for place, pair in enumerate(found.pairs)}


@pytest.mark.parametrize("vary", ["controller.own.params.gain = { list = [0.5, 2.0] }", "seeds = true"])
def test_a_law_that_is_refused_in_preparation_loses_its_own_rows_only(tmp_path: Path, vary: str) -> None:
    (tmp_path / "law.py").write_text(REFUSES)
    own = WITH_GAIN if "gain" in vary else WITH_GAIN.replace("0.5", "2.0")  # of some variants, or of all
    study = ensembles.study(tmp_path, vary=f"{own}[vary]\n{vary}")
    folder, other = tmp_path / "all", tmp_path / "others"
    folder.mkdir()
    other.mkdir()
    found = sweeping.run(sweeping.plan(study, 17), folder, Here())
    assert found is not None
    gains = found.ensemble.drawn.get("controller.own.params.gain", [2.0] * 17)
    refused = {(variant, 2) for variant in range(17) if gains[variant] > 1}
    assert set(found.errors) == refused and refused
    where = 'study.toml: controller.own.object: "law.py:Law": law.py line 5: ValueError: too much'
    assert all(text.startswith(where) for text in found.errors.values())
    for place, values in enumerate(rows_without(study, other).values()):
        assert np.array_equal(found.values[:, place], values)


def test_a_start_map_with_a_flipped_byte_loses_the_rows_of_its_law_only(tmp_path: Path) -> None:
    learned = StoredMap(np.full(64, 0.01, np.float32), (1,), (1.0,))
    data = bytearray(bytes(learned))
    data[len(data) // 2] ^= 4
    (tmp_path / "learned.cglmap").write_bytes(data)
    text = ensembles.TEXT.replace("cells = 64", 'cells = 64\nstart = { map = "learned.cglmap" }')
    found = sweeping.run(sweeping.plan(studies.study(tmp_path, None, text), 5), tmp_path, Here())
    assert found is not None
    assert set(found.errors) == {(variant, 1) for variant in range(5)}
    where = 'study.toml: controller.pi-ilc.start.map: "learned.cglmap": '
    assert all(text.startswith(where) for text in found.errors.values())
    assert np.all(np.isfinite(found.values[:, 0]))


def test_a_map_that_fits_some_variants_loses_the_others_rows_only(tmp_path: Path) -> None:
    """A memory over time begins with nothing."""
    (tmp_path / "learned.cglmap").write_bytes(bytes(StoredMap(np.full(256, 0.01, np.float32), (1,), (1.0,))))
    start = 'cells = 256\nmemory = "angle"\nstart = { map = "learned.cglmap" }'
    text = ensembles.TEXT.replace("cells = 64", start)
    vary = '[vary]\ncontroller.pi-ilc.memory = { list = ["angle", "time"] }\n'
    study = studies.study(tmp_path, None, text.replace(ensembles.VARY, vary))
    found = sweeping.run(sweeping.plan(study, 16), tmp_path, Here())
    assert found is not None
    memory = found.ensemble.drawn["controller.pi-ilc.memory"]
    assert set(found.errors) == {(variant, 1) for variant in range(16) if memory[variant] == "time"}
    assert len(found.errors) == 8
    assert np.all(np.isfinite(found.values[:, 0]))


def test_a_defect_of_cogless_ends_a_sweep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(study: Any, scenario: str, trace: Any) -> dict[str, Any]:
        raise TypeError("of cogless itself")

    monkeypatch.setattr(carry_out, "measure", measure)
    with pytest.raises(RunDefect) as error:
        sweeping.run(sweeping.plan(ensembles.study(tmp_path), 3), tmp_path, Here())
    assert isinstance(error.value.__cause__, TypeError)


def test_a_study_travels_with_its_files(tmp_path: Path) -> None:
    home = tmp_path / "home"
    (home / "in").mkdir(parents=True)
    (home / "law.py").write_text("from helper import GAIN\n" + FRAGILE.replace("0.01", "GAIN"))
    (home / "helper.py").write_text("GAIN = 0.01\n")
    own = '[controller.own]\nlaw = "python"\nobject = "../law.py:Law"\nparams = { gain = 0.5 }\n'
    own += f'label = "{300 * "x"}"\n'  # longer than a file's name may be
    parcel = pack(ensembles.study(home / "in", vary=own))
    assert set(parcel.files) == {"../law.py", "../helper.py"}
    (expected,) = run_study(unpacked(parcel), ["low/own"]).runs
    (home / "law.py").unlink()  # as on another machine
    there = unpacked(replace(parcel, digest="another"))
    assert there.source.path.parent != home / "in"
    (found,) = run_study(there, ["low/own"]).runs
    assert found.metrics == expected.metrics


def test_no_file_travels_whose_name_is_another_key_s_text(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "secret.txt").write_text("a secret")
    rows = "".join(f"{30 * n},{n % 2}\n" for n in range(12))
    (tmp_path / "in" / "load.csv").write_text(f"angle [deg],torque [mN*m]\n{rows}")
    secret = "../secret.txt"
    files = {"mechanics.load": {"angle_table": {"file": "load.csv"}}}
    changes = {
        "title": secret,
        "description": secret,
        "controller.pi.label": secret,
        "assumption": [{"about": secret, "reason": secret}],
    }
    study = ensembles.study(tmp_path / "in", files | changes)
    assert study.title == secret
    assert list(pack(study).files) == ["load.csv"]


@pytest.mark.parametrize(
    ("values", "kind", "kept"),
    [
        ([1, 2**64 - 1], "uint64", [1, 2**64 - 1]),
        ([-1, 2], "int64", [-1, 2]),
        ([1, 2.5], "double", [1.0, 2.5]),
        ([True, False], "string", ["true", "false"]),
        (["star", 1], "string", ["star", "1"]),
        ([[1, 2], [3]], "string", ["[1, 2]", "[3]"]),
    ],
)
def test_values_of_a_key_are_numbers_or_texts(values: list[Any], kind: str, kept: list[Any]) -> None:
    found = sweep_table._array(values)
    assert (str(found.type), found.to_pylist()) == (kind, kept)


# mistakes


def test_shards_of_different_sweeps_are_refused(tmp_path: Path) -> None:
    planned = plan(tmp_path)
    for index in (0, 1):
        sweeping.run(planned, tmp_path, Here(), sweeping.Shard(index, 2))
    other = sweeping.plan(ensembles.study(tmp_path, {"mechanics.inertia": "2.6e-4 kg*m^2"}), COUNT)
    first = tmp_path / "shard-1-of-2.jsonl"
    with pytest.raises(StudyError) as error:
        sweeping.merge(other, tmp_path)
    digests = planned.identity["study"], other.identity["study"]
    assert str(error.value) == f"{first}: study: {digests[0]}: expected the same study, or another directory"
    with pytest.raises(StudyError) as error:
        sweeping.merge(plan(tmp_path, 41), tmp_path)
    assert (
        str(error.value)
        == f"{first}: variants: 40: expected 41, which this command has, or another directory"
    )
    with pytest.raises(
        StudyError, match=r"version: 0\.0\.1: expected .*, which this command has, or another directory$"
    ):
        about, rest = first.read_bytes().split(b"\n", 1)
        first.write_bytes(sweeping._line({**json.loads(about[9:]), "version": "0.0.1"}) + rest)
        sweeping.merge(planned, tmp_path)


def test_missing_and_unfinished_shards_are_named(tmp_path: Path) -> None:
    planned = plan(tmp_path)
    with pytest.raises(StudyError, match=r": no shards: expected files such as shard-1-of-20\.jsonl$"):
        sweeping.merge(planned, tmp_path)
    (tmp_path / "shard-1-of-two.jsonl").touch()
    with pytest.raises(StudyError, match=r"two\.jsonl: expected a name such as shard-1-of-20\.jsonl$"):
        sweeping.merge(planned, tmp_path)
    (tmp_path / "shard-1-of-two.jsonl").unlink()
    sweeping.run(planned, tmp_path, Here(), sweeping.Shard(0, 2))
    with pytest.raises(StudyError) as error:
        sweeping.merge(planned, tmp_path)
    second = tmp_path / "shard-2-of-2.jsonl"
    assert str(error.value) == f"{second}: no such file or directory: expected a shard's file"
    sweeping.run(planned, tmp_path, Here(), sweeping.Shard(1, 2))
    lines = (tmp_path / "shard-1-of-2.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "shard-1-of-2.jsonl").write_bytes(b"".join(lines[:-1]))
    with pytest.raises(
        StudyError, match="1 of 2 chunks: expected a finished shard: repeat the command that began"
    ):
        sweeping.merge(planned, tmp_path)


def test_one_writer_at_a_time(tmp_path: Path) -> None:
    planned = plan(tmp_path)
    with sweeping.opened(tmp_path / "journal.jsonl", planned.identity), pytest.raises(StudyError) as error:
        sweeping.run(planned, tmp_path, Here())
    assert (
        str(error.value)
        == f"{tmp_path / 'journal.jsonl'}: in use: expected no other command that writes here"
    )


def test_a_line_that_a_kill_cut_off_is_written_anew(tmp_path: Path) -> None:
    path, about = tmp_path / "journal.jsonl", {"study": "x"}
    with sweeping.opened(path, about) as first:
        first.add(0, [1.5])
    with path.open("ab") as file:
        file.write(b"[1,[2.")
    with sweeping.opened(path, about) as second:
        assert second.finished == {0: [1.5]}
        second.add(1, [2.5])
    assert sweeping.read(path, about) == {0: [1.5], 1: [2.5]}


def test_a_file_that_is_no_journal(tmp_path: Path) -> None:
    (tmp_path / "journal.jsonl").write_text("hello\n")
    with pytest.raises(StudyError, match="not readable: expected a file that this command has written"):
        sweeping.run(plan(tmp_path), tmp_path, Here())


def test_a_journal_of_an_earlier_cogless_has_no_checksums(tmp_path: Path) -> None:
    planned, path = plan(tmp_path), tmp_path / "journal.jsonl"
    path.write_text(json.dumps(planned.identity) + "\n[0,[5]]\n")
    with pytest.raises(StudyError) as error:
        sweeping.run(planned, tmp_path, Here())
    why = "not readable: was written by an earlier cogless, without checksums: expected another directory"
    assert str(error.value) == f"{path}: {why}"
    elsewhere = tmp_path / "elsewhere"  # as it advises
    elsewhere.mkdir()
    assert sweeping.run(planned, elsewhere, Here()) is not None


def test_no_flipped_bit_gives_other_numbers(
    tmp_path: Path, expected: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    """A damaged chunk runs again; a damaged first line is refused, and nothing of the file is lost."""
    planned, path, chance = plan(tmp_path), tmp_path / "journal.jsonl", random.Random(36)
    sweeping.run(planned, tmp_path, Here())
    whole = path.read_bytes()
    first_end, last = whole.index(b"\n"), len(whole) - 1
    places = [0, 8, 9, first_end, last, *(chance.randrange(first_end + 1, last) for _ in range(12))]
    for place in places:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << chance.randrange(8)
        path.write_bytes(damaged)
        if place <= first_end:
            with pytest.raises(StudyError, match="not readable: expected a file that this command"):
                sweeping.run(planned, tmp_path, Here())
            assert path.read_bytes() == damaged
        else:
            done: list[int] = []
            swept = sweeping.run(planned, tmp_path, Here(), progress=done.append)
            assert content(swept, tmp_path) == expected and done[0] < done[-1] == COUNT
    assert f"Warning: {path}: line " in capsys.readouterr().err


@pytest.mark.parametrize("value", [[0, 5], [0, None], [0], 5, None, {"0": []}, ["0", []], [[0], []]])
def test_a_line_that_holds_no_chunk_is_not_used(
    tmp_path: Path, value: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    path, about = tmp_path / "journal.jsonl", {"study": "x"}
    with sweeping.opened(path, about) as first:
        first.add(1, [2.5])
    with path.open("ab") as file:
        file.write(sweeping._line(value) + b"00000000 [0,[1.5]]\n")
    assert sweeping.read(path, about) == {1: [2.5]}
    lines = [f"Warning: {path}: line {number} is damaged and not used.\n" for number in (3, 4)]
    assert capsys.readouterr().err == "".join(lines)


def test_a_file_of_the_users_is_not_cut(tmp_path: Path) -> None:
    path, target = tmp_path / "journal.jsonl", tmp_path / "target"
    path.write_text("mine\nwithout an end")
    with pytest.raises(StudyError, match="not readable"):
        sweeping.run(plan(tmp_path), tmp_path, Here())
    assert path.read_text() == "mine\nwithout an end"
    path.rename(target)
    path.symlink_to(target)
    with pytest.raises(
        StudyError,
        match=r"journal\.jsonl: a symbolic link, which may lead anywhere: "
        r"expected a file that can be written$",
    ):
        sweeping.run(plan(tmp_path), tmp_path, Here())
    assert target.read_text() == "mine\nwithout an end"


def test_a_first_line_that_a_kill_cut_off_begins_anew(tmp_path: Path) -> None:
    path, about = tmp_path / "journal.jsonl", {"study": "x"}
    path.write_bytes(sweeping._line(about)[:12])
    with sweeping.opened(path, about) as kept:
        kept.add(0, [1.5])
    assert sweeping.read(path, about) == {0: [1.5]}


@pytest.mark.parametrize("count", ["50000000", "999999999", "1000000000", "0", "\u00b2"])
def test_a_shard_of_a_huge_number_is_refused_at_once(tmp_path: Path, count: str) -> None:
    planned, path = plan(tmp_path), tmp_path / f"shard-1-of-{count}.jsonl"
    if count in ("50000000", "999999999"):
        shard = sweeping.Shard(0, int(count))
        sweeping.run(planned, tmp_path, Here(), shard)
        expected = rf"shard-2-of-{count}\.jsonl: no such file or directory: expected a shard's file$"
    else:
        path.touch()
        expected = r": expected a name such as shard-1-of-20\.jsonl$"
    begun = time.monotonic()
    with pytest.raises(StudyError, match=expected):
        sweeping.merge(planned, tmp_path)
    assert time.monotonic() - begun < 1


def test_a_full_disk_is_one_line(tmp_path: Path) -> None:
    with open("/dev/full", "wb", buffering=0) as full, pytest.raises(StudyError) as error:
        sweeping.Journal(tmp_path / "journal.jsonl", full, {}).add(0, [])
    expected = "no space left on device: expected a file that can be written"
    assert str(error.value) == f"{tmp_path / 'journal.jsonl'}: {expected}"


def test_a_study_without_metrics(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="metric: missing: expected one or more metrics to compare"):
        plan(tmp_path, changes={"metric": []})


# the command


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str], expected: bytes) -> None:
    study, out = studies.write(tmp_path, ensembles.TEXT), tmp_path / "out"
    code, said, err = cogless(capsys, "sweep", study, "-n", COUNT, "-o", out, "-j", 2)
    assert (code, err) == (0, "")
    assert {path.name for path in out.iterdir()} == {"journal.jsonl", "sweep.parquet", "report.html"}
    assert (out / "sweep.parquet").read_bytes() == expected
    lines = said.splitlines()
    assert lines[0].startswith(f"low: Ripple keeps its limit in this share of {COUNT} variants: ")
    assert lines[-2:] == [f"Table: {out / 'sweep.parquet'}", f"Report: {out / 'report.html'}"]


def test_table_and_report_are_one_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    study, out = studies.write(tmp_path, ensembles.TEXT), tmp_path / "out"
    out.mkdir()
    (out / "results.json").write_text('{"files": {}}')  # of a run

    def swept(count: int) -> tuple[int, dict[str, bytes]]:
        code, _, _ = cogless(capsys, "sweep", study, "-n", count, "-o", out, "-j", 1)
        return code, {path.name: path.read_bytes() for path in out.iterdir() if path.suffix != ".jsonl"}

    code, before = swept(3)
    assert (code, set(before)) == (0, {"results.json", "sweep.parquet", "report.html"})

    def full(*of: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("cogless.report.sweep_report.write", full)
        assert swept(4) == (2, before)
    code, after = swept(4)
    assert code == 0 and all(after[name] != before[name] for name in ("sweep.parquet", "report.html"))


def test_shards_by_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str], expected: bytes) -> None:
    study, out = studies.write(tmp_path, ensembles.TEXT), tmp_path / "out"
    arguments = ("sweep", study, "-n", COUNT, "-o", out, "-j", 1)
    for shard in ("1/2", "2/2"):
        code, said, _ = cogless(capsys, *arguments, "--shard", shard)
        assert (code, said.startswith("Shard: ")) == (0, True)
    assert cogless(capsys, *arguments, "--merge")[0] == 0
    assert (out / "sweep.parquet").read_bytes() == expected


MISTAKES = {
    ("--shard", "4/3"): '--shard: "4/3": expected I/N, such as 3/20, with I from 1 to N',
    ("--shard", "\u00b2/3"): '--shard: "\u00b2/3": expected I/N, such as 3/20, with I from 1 to N',
    ("--shard", "x"): '--shard: "x": expected I/N, such as 3/20, with I from 1 to N',
    ("--only", "low/none"): '{study}: --only: "low/none": expected SCENARIO/CONTROLLER of low/pi, low/pi-ilc',
    ("--set", "vary.seeds=3"): "{study}: vary.seeds: 3: expected true or false",
    ("--merge",): "{out}: no shards: expected files such as shard-1-of-20.jsonl",
}


@pytest.mark.parametrize("options", MISTAKES)
def test_mistakes_of_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...]
) -> None:
    study, out = studies.write(tmp_path, ensembles.TEXT), tmp_path / "out"
    code, said, err = cogless(capsys, "sweep", study, "-o", out, *options)
    assert (code, said) == (2, "")
    assert err == MISTAKES[options].format(study=study, out=out) + "\n"


@pytest.mark.parametrize(
    ("missing", "command"), [("pyarrow", "sweep"), ("SALib", "sweep"), ("SALib", "tune"), ("optuna", "tune")]
)
def test_a_missing_extra_is_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    missing: str,
    command: str,
) -> None:
    from importlib import util

    there = util.find_spec
    for module in ("sweep_table", "search"):
        monkeypatch.setattr(
            f"cogless.ensemble.{module}.find_spec", lambda name: None if name == missing else there(name)
        )
    code, said, err = cogless(
        capsys, command, studies.write(tmp_path, ensembles.TEXT), "-o", tmp_path / "out"
    )
    assert (code, said) == (2, "")
    assert err == f"{command}: expected more packages: pip install 'cogless[{command}]'\n"


def test_killed_and_started_again(tmp_path: Path, expected: bytes) -> None:
    study, out = studies.write(tmp_path, ensembles.TEXT), tmp_path / "out"
    command = ("sweep", study, "-n", COUNT, "-o", out, "-j", 1)
    running = forked(tmp_path, *command)
    file, until = out / "journal.jsonl", time.monotonic() + 60
    while time.monotonic() < until and not (file.is_file() and file.read_bytes().count(b"\n") >= 2):
        time.sleep(0.01)
    os.killpg(running.pid, signal.SIGKILL)
    assert running.end() == -signal.SIGKILL
    assert forked(tmp_path, *command).end() == 0
    assert (out / "sweep.parquet").read_bytes() == expected
    assert sweeping._value(file.read_bytes().splitlines()[0])["runs"] == ["low/pi", "low/pi-ilc"]


# Dask


@contextmanager
def cluster(workers: int) -> Iterator[Any]:
    distributed = pytest.importorskip("distributed", reason="needs the extra cogless[dask]")
    options = {"n_workers": workers, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    # as Dask starts them: a fork would keep what this process's other threads had locked, and may hang
    with distributed.LocalCluster(**options) as found:
        yield found


@pytest.mark.filterwarnings("ignore")  # of Dask, about workers that die
def test_a_dask_cluster_that_loses_a_worker_gives_the_same_table(tmp_path: Path, expected: bytes) -> None:
    with cluster(2) as found, executing.dask(found.scheduler_address) as workers:
        process = next(iter(found.workers.values())).process.process

        def kill(done: int) -> None:
            if done >= 16 and process.is_alive():
                os.kill(process.pid, signal.SIGKILL)

        swept = sweeping.run(plan(tmp_path), tmp_path, workers, progress=kill)
        end = time.monotonic() + 20.0
        while process.is_alive() and time.monotonic() < end:
            time.sleep(0.01)  # the kill may have been the last thing that the sweep did
        assert not process.is_alive()
    assert content(swept, tmp_path) == expected


def test_a_cluster_that_does_not_answer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="needs the extra cogless[dask]")
    monkeypatch.setattr(executing, "CLUSTER_PATIENCE", 0.3)
    study = studies.write(tmp_path, ensembles.TEXT)
    code, said, err = cogless(capsys, "sweep", study, "-o", tmp_path / "out", "--dask", "tcp://127.0.0.1:1")
    assert (code, said) == (2, "")
    assert err == (
        "--dask: tcp://127.0.0.1:1: no answer: expected the address of a Dask scheduler, "
        "such as tcp://127.0.0.1:8786\n"
    )
