"""A value that a page changes: all bytes that the engine gets are those of `cogless run --set`."""

import json
import random
import tomllib

import live_studies
import pytest
from node import NO_NODE, run_node

from cogless.design.auto import load
from cogless.errors import StudyError
from cogless.live import toml
from cogless.live.blobs import held
from cogless.live.keys import adjustable, packed
from cogless.live.page import data
from cogless.study.reading import changed

DESCRIBED = """
const { described, runs } = liveBytes(given.page);
return given.values.map((values) => Object.fromEntries([...runs.keys()].map((place) =>
  [place, Buffer.from(described(place, values).data).toString("hex")])));
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    study = live_studies.study(tmp_path_factory.mktemp("small"))
    return study, adjustable(study)


def drawn(found, rng):
    """A value for a few keys, by key: one of the stops, or as a slider or a hand gives it."""
    values = {}
    for key in rng.sample(found.keys, min(len(found.keys), rng.randint(1, 8))):
        one = key.candidate
        if key.stops:
            values[one.key] = rng.choice(key.stops)
        elif one.whole:
            values[one.key] = float(rng.randint(int(one.low), int(one.high)))
        else:
            values[one.key] = float(f"{rng.uniform(one.low, one.high):.{rng.randint(1, 9)}g}")
    return values


def bytes_of(study, found, values):
    """All descriptions with these values, as `--set` makes them; None if the study refuses them together."""
    texts = {key.candidate.key: key.candidate for key in found.keys}
    try:
        other = changed(study, {name: texts[name].text(value) for name, value in values.items()})
        return {"/".join(place): blob.data.hex() for place, blob in packed(other, held(other)).items()}
    except (StudyError, ValueError):
        return None


def same_bytes(folder, study, found, seed, count):
    rng = random.Random(seed)
    sets = [values for values in (drawn(found, rng) for _ in range(count)) if bytes_of(study, found, values)]
    assert len(sets) > count / 2
    given = {"page": data(study, found, "cogless run x"), "values": [list(v.items()) for v in sets]}
    made = run_node(folder, ("bytes.js",), DESCRIBED, given)
    for values, by_page in zip(sets, made, strict=True):
        assert by_page == bytes_of(study, found, values), values


@pytest.mark.skipif(bool(NO_NODE), reason=NO_NODE)
def test_changed_values_give_the_bytes_of_set(tmp_path, small):
    same_bytes(tmp_path, *small, seed=1, count=40)


@pytest.mark.skipif(bool(NO_NODE), reason=NO_NODE)
def test_changed_values_of_a_shipped_study_give_the_bytes_of_set(tmp_path):
    study = load("uomodri-dead-time")
    same_bytes(tmp_path, study, adjustable(study), seed=2, count=12)


def test_gains_motor_load_and_sensors_can_be_changed(small):
    _, found = small
    names = {key.candidate.key: key for key in found.keys}
    assert names["controller.pi-ilc.gain"].stops == ()
    assert names['scenario.low.override."mechanics.inertia"'].stops == ()
    assert names["scenario.low.duration"].stops == ()
    # through a rule, or through several sums: tabulated
    assert len(names["controller.pi.tuning.phase_margin"].stops) > 15
    assert 2500 in names['scenario.low.override."drive.position_sensor.lines"'].stops
    for word in ("reference", "load", 'override."motor.R_s"', 'override."motor.cogging.0.torque"'):
        assert f"scenario.low.{word}" in names
    assert "scenario.step.reference.speed" in names


def test_no_two_keys_set_the_same_number(small):
    _, found = small
    all_of = [
        (place, one.number.offset)
        for key in found.keys
        for place, lands in key.lands.items()
        for one in lands
    ]
    assert len(all_of) == len(set(all_of))


def test_a_scenarios_key_leaves_the_gains_alone(small):
    """The plant gets heavier, and the controller isn't told."""
    _, found = small
    (key,) = [k for k in found.keys if k.candidate.key == 'scenario.low.override."mechanics.inertia"']
    assert {one.number.path for lands in key.lands.values() for one in lands} == {"mechanics.inertia"}
    assert {place[0] for place in key.lands} == {"low"}


def joined(pieces):
    return "".join(piece if isinstance(piece, str) else piece[1] for piece in pieces)


def test_the_lines_of_the_study_read_back_as_the_study(small):
    study, _ = small
    text = "\n".join(
        "\n".join(
            [f"[{s['heading']}]"] * bool(s["heading"])
            + [f"{key} = {joined(value)}" for key, value in s["lines"]]
        )
        for s in toml.sections(study._source)
    )
    assert tomllib.loads(text) == study._source.tables
    assert json.loads(toml.text('a "b" \x7f\n')) == 'a "b" \x7f\n'
