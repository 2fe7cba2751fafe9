"""Which keys of a made-up study a page can change, those that it leaves out, and what its scripts get."""

import base64
import hashlib
import struct
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cogless.errors import StudyError
from cogless.live import candidates, keys, live_page
from cogless.live import description as room
from cogless.live.candidates import YOURS, Candidate
from cogless.live.description import Number, Packed
from cogless.live.keys import OTHER_SHAPE, Key, Landing
from cogless.live.own_motor import POLE_PAIRS, Product
from cogless.run.run_plan import NEVER_LEARNS

PLACE = ("low", "pi", "run")
NAMES = ("a", "b", "c", "d", "e", "f", "g", "h", "k", "few", "half")
NUMBERS = tuple(Number(f"n{n}", 8 * n, "d") for n in range(6))


def candidate(name, low=1.0, high=9.0, start=2.0, **more):
    ends = {"least": low / 100, "most": 100 * high} | more
    return Candidate(
        key=name, label=name, group="Group", unit="", factor=1.0, start=start, low=low, high=high, **ends
    )


def described(values):
    """The bytes of a run, in which each number depends on the keys in another way."""
    at = dict.fromkeys(NAMES, 2.0) | values
    if at["e"] != 2 or at["k"] > 9 or at["few"] not in (1, 2) or at["half"] > 5:
        raise StudyError("study.toml: controller.pi: expected less")
    numbers = (
        at["a"] * at["b"] * at["half"] / 2, at["c"] ** 2, min(at["g"], 10.0), at["h"] + (at["h"] > 8),
        at["k"], at["few"],
    )  # fmt: skip
    return {PLACE: Packed(struct.pack("<6d", *numbers), NUMBERS, (str(at["f"] == 2),))}


@pytest.fixture
def adjusted(monkeypatch):
    def of(*listed):
        for module in (keys, candidates):
            monkeypatch.setattr(module, "page_runs", lambda study: [PLACE[:2]])
        monkeypatch.setattr(keys, "packed", lambda study, *_: described(study.values))
        monkeypatch.setattr(keys, "changed", lambda study, values: SimpleNamespace(values=values))
        monkeypatch.setattr(keys, "_candidates", lambda study, told: list(listed))
        return keys.adjustable(SimpleNamespace(drive=None, values={}))

    return of


def test_keys_are_direct_or_have_stops_or_are_left_out(adjusted):
    """A key that turns out to be no multiple only at further values comes last, with stops."""
    listed = [candidate(name) for name in NAMES if name != "half"]
    found = adjusted(*listed)
    by_name = {key.candidate.key: key for key in found.keys}
    assert list(by_name) == ["a", "c", "g", "k", "h"]
    assert found.left_out == [
        ("b", "another key of the page already sets the numbers that this key changes"),
        ("e", "expected less"),
        ("f", OTHER_SHAPE),
        ("few", "expected less"),
    ]
    for name, landing in (
        ("a", Landing(NUMBERS[0], 2.0)),
        ("g", Landing(NUMBERS[2])),
        ("k", Landing(NUMBERS[4])),
    ):
        assert by_name[name].lands == {PLACE: (landing,)} and by_name[name].stops == ()
    squares, jumps = by_name["c"], by_name["h"]
    evenly = sorted({*(round(1 + 0.4 * n, 1) for n in range(21)), 2.0})
    assert list(squares.stops) == list(jumps.stops) == evenly
    ((landing,),) = squares.lands.values()
    assert landing.number is NUMBERS[1] and landing.values == pytest.approx([x**2 for x in squares.stops])
    ((landing,),) = jumps.lands.values()
    assert landing.values == pytest.approx([x + (x > 8) for x in jumps.stops])


def test_a_field_takes_more_than_its_slider_only_if_the_key_stays_right_there(adjusted):
    """Key g saturates above 10, k is refused above 9, and c has stops."""
    found = adjusted(*(candidate(name) for name in "acgk"))
    fields = {key.candidate.key: (key.candidate.least, key.candidate.most) for key in found.keys}
    assert fields == {"a": (0.01, 900.0), "c": (1.0, 9.0), "g": (0.01, 9.0), "k": (0.01, 9.0)}
    (alone,) = adjusted(candidate("k")).keys
    assert (alone.candidate.least, alone.candidate.most) == (0.01, 9.0)
    (reaches,) = adjusted(candidate("g", most=11.0)).keys  # halfway from the end to the slider it is right
    assert (reaches.candidate.least, reaches.candidate.most) == (0.01, 10.0)


def test_a_key_that_the_study_refuses_near_one_end_keeps_the_rest_of_its_slider(adjusted):
    """The study refuses 6, the first value that is tried. Others show how the key sets its number."""
    (key,) = adjusted(candidate("half")).keys
    assert key.lands == {PLACE: (Landing(NUMBERS[0], 2.0),)}


def test_stops_that_are_given_are_all_that_is_tried(adjusted):
    (key,) = adjusted(candidate("a", stops=(1.0, 2.0, 4.0))).keys
    assert key.stops == (1.0, 2.0, 4.0)
    assert [one.values for one in key.lands[PLACE]] == [(2.0, 4.0, 8.0)]
    for stops in ((1.0, 2.0), (1.0, 3.0, 4.0)):  # too few, or none that is the study's
        found = adjusted(candidate("a", stops=stops))
        assert (found.keys, found.left_out) == ([], [("a", OTHER_SHAPE)])
    found = adjusted(candidate("few", stops=(1.0, 2.0, 4.0)))  # of three two are accepted
    assert (found.keys, found.left_out) == ([], [("few", OTHER_SHAPE)])


def test_what_moves_nothing_is_neither_a_key_nor_left_out(adjusted):
    found = adjusted(candidate("d"))
    assert (found.keys, found.left_out) == ([], [])


@pytest.mark.parametrize(("group", "key"), [(YOURS, "motor.kv"), ("Group", "other")])
def test_ends_of_a_slider_are_those_that_the_study_accepts(monkeypatch, group, key):
    """But for the keys of one's own motor, which decide together, and for stops."""
    monkeypatch.setattr(keys, "_accepted", lambda study, of, end: max(3.0, min(5.0, end)))
    given = replace(candidate(key, start=4.0), group=group)
    found = keys._bounded(None, given)
    if group == YOURS:
        assert found is given
    else:
        assert (found.least, found.low, found.high, found.most) == (3.0, 3.0, 5.0, 5.0)
    stopped = replace(given, stops=(1.0, 9.0))
    assert keys._bounded(None, stopped) is stopped
    own = replace(given, key="mechanics.coulomb_friction")
    assert keys._bounded(None, own).high == 5.0


# --- what the page's scripts get


def test_a_run_tells_where_the_page_reads_and_how_its_law_stops_learning():
    numbers = (
        Number("page.ticks", 8, "q"),
        Number("controller.learning_start", 16, "d"),
        Number("motor.R_s", 24, "d"),
    )
    made = live_page._run(Packed(b"abc", numbers, ("page 5 1", "motor 5 2")))
    assert made == {
        "bytes": base64.b64encode(b"abc").decode(),
        "about": {"page.ticks": [8, "q"]},
        "off": [16, "d", NEVER_LEARNS],
        "learned": None,
    }
    learned = (Number("page.learned.0", 40, "d"), Number("controller.config.k_3", 16, "f"))
    made = live_page._run(Packed(b"", learned, ("page.learned 2x480 8 2",)))
    assert (made["about"], made["off"], made["learned"]) == ({}, [16, "f", 0.0], [40, 2, 480])
    assert live_page._off({}) is None


def test_landings_and_products_are_lists():
    number = Number("n", 8, "f")
    direct, stops = Key(candidate("a"), {}), Key(candidate("a"), {}, (1.0, 2.0))
    assert live_page._landing(direct, Landing(number, 2.0, True)) == [8, "f", 2.0, True]
    assert live_page._landing(stops, Landing(number, values=(3.0, 4.0))) == [8, "f", [3.0, 4.0]]
    assert live_page._product(Product(number, 3.0, {POLE_PAIRS: 2}, (1.0,), (0.5,))) == [
        8, "f", 3.0, {POLE_PAIRS: 2}, (1.0,), (0.5,)
    ]  # fmt: skip
    assert live_page._place(PLACE) == "low/pi/run"


def test_keys_that_the_page_leaves_out_are_told_with_the_controllers(monkeypatch):
    monkeypatch.setattr(live_page, "left_out", lambda study: ["Mine: its law is <code>."])
    found = SimpleNamespace(left_out=[("b", "why not")])
    lines = "<li>Mine: its law is &lt;code&gt;.</li><li>b: why not.</li>"
    assert live_page._left_out(None, found) == (
        f"<details><summary>Keys that the page can't change</summary><ul>{lines}</ul></details>"
    )
    monkeypatch.setattr(live_page, "left_out", lambda study: [])
    assert live_page._left_out(None, SimpleNamespace(left_out=[])) == ""


def test_scripts_are_allowed_by_their_hashes():
    one, two = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in ("a", "ü"))
    assert live_page._hashes(["a", "ü"]) == f"'sha256-{one}' 'sha256-{two}'"


# --- the bytes of a run


def read(data, numbers, at=0):
    """The value that packed bytes describe, and where the next one begins; `numbers` tells their forms."""
    kind, count = struct.unpack_from("<II", data, at)
    at += 8
    forms = {number.offset: number.format for number in numbers}

    def number():
        nonlocal at
        at += 8
        return struct.unpack_from(f"<{forms[at - 8]}", data, at - 8)[0]

    def whole():
        nonlocal at
        at += 8
        return struct.unpack_from("<Q", data, at - 8)[0]

    def text(size):
        nonlocal at
        begin, at = at, at + size + -size % 8
        return data[begin : begin + size].decode()

    def value():
        nonlocal at
        found, at = read(data, numbers, at)
        return found

    if kind in (room.NONE, room.INTEGER, room.NATURAL, room.REAL):
        assert count == 0
    match kind:
        case room.NONE:
            found = None
        case room.BOOL:
            found = bool(count)
        case room.INTEGER | room.NATURAL | room.REAL:
            found = number()
        case room.TEXT:
            found = text(count)
        case room.NUMBERS:
            found = [number() for _ in range(count)]
        case room.LIST:
            found = [value() for _ in range(count)]
        case room.TABLE:
            found = {text(whole()): value() for _ in range(count)}
        case room.MATRIX:
            columns = whole()
            found = [[number() for _ in range(columns)] for _ in range(count)]
    return found, at


def test_a_description_reads_back_from_its_bytes():
    """Whole numbers have a sign below 2**63. All but its numbers is its shape."""
    description = {
        "controller": {"law": "mine"}, "nothing": None, "yes": True, "no": False, "half": 0.5,
        "least": -(2**63), "most": 2**63 - 1, "more": 2**63, "text": "a longer text", "eight": "12345678",
        "numbers": [1.0, 2.5], "mixed": [1, "a", [0.25]], "empty": [], "pair": (3.0, 4.0),
        "vector": np.array([1.5, 2.5]), "matrix": np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
        "scalar": np.float32(0.25), "count": np.int64(7),
    }  # fmt: skip
    made = room.pack(description, "double")
    found, end = read(made.data, made.numbers)
    assert end == len(made.data) and len(made.data) % 8 == 0
    wanted = {key: x.tolist() if isinstance(x, np.ndarray) else x for key, x in description.items()}
    assert found == {**wanted, "pair": [3.0, 4.0]}
    at = {number.path: number for number in made.numbers}
    forms = {"least": "q", "most": "q", "more": "Q", "half": "d", "yes": "I", "matrix.5": "d", "mixed.0": "q"}
    assert {path: at[path].format for path in forms} == forms
    assert [at[path].read(made.data) for path in ("yes", "no", "matrix.5", "vector.1")] == [1, 0, 6, 2.5]
    other = room.pack({**description, "half": 1.5, "yes": False, "numbers": [3.0, 4.0]}, "double")
    assert other.shape == made.shape and other.numbers == made.numbers and other.data != made.data
    changed = {"text": "another text", "numbers": [1.0], "nothing": 0, "matrix": np.ones((3, 2))}
    for name, value in changed.items():
        assert room.pack({**description, name: value}, "double").shape != made.shape
