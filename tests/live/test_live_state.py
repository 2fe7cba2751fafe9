"""What a page shows comes back from its address: scenario, controllers, trial, and the values of all keys."""

import itertools
import random
from pathlib import Path

import live_studies
import pytest
from node import NO_NODE, run_node

from cogless.live.candidates import candidates, trial_candidates
from cogless.live.description import page_runs
from cogless.live.keys import AdjustableKeys, Key
from cogless.live.live_page import _key, data
from cogless.study import TrialStudy, changed, load

pytestmark = pytest.mark.skipif(bool(NO_NODE), reason=NO_NODE)

ROOT = Path(__file__).parents[2]
NOT_ON_PAGE = {"arena", "printer", "printer-ramps"}  # many plants; a law without gains to try
SHIPPED = sorted({path.stem for path in (ROOT / "studies").glob("*.toml")} - NOT_ON_PAGE)
MY_MOTOR = ROOT / "examples" / "my_motor.toml"
RESISTANCE, INDUCTANCE = "motor.resistance_line_to_line", "motor.inductance_line_to_line"
THERE_AND_BACK = """
const keys = new Map(given.page.keys.map((key) => [key.key, key]));
const ratio = given.page.motor && liveBytes(given.page).ratio;
const fresh = () => liveState(given.page, keys, ratio, String);
const object = Object.fromEntries;
const plain = (page) => ({ ...page.state, values: object(page.state.values), notes: object(page.notes) });
const opened = (address) => {
  const page = fresh();
  page.fromAddress(address);
  return plain(page);
};
return {
  states: given.states.map((wanted) => {
    const page = fresh();
    page.fromAddress("#");
    Object.assign(page.state, { scenario: wanted.scenario, shown: wanted.shown, trial: wanted.trial });
    for (const [name, x] of wanted.values) page.set(keys.get(name), x);
    page.notes.clear();
    return { address: page.address(), before: plain(page), after: opened(page.address()) };
  }),
  opened: given.addresses.map(opened),
};
"""


def there_and_back(folder, page, states, addresses=()):
    given = {"page": page, "states": states, "addresses": list(addresses)}
    return run_node(folder, ("bytes.js", "state.js"), THERE_AND_BACK, given)


def drawn(page, seed):
    """States at random, the values of some keys within their fields among them, set in any order."""
    draw = random.Random(seed)
    for _ in range(20):
        scenario = draw.choice(page["scenarios"])
        shown = draw.sample(scenario["controllers"], draw.randint(1, len(scenario["controllers"])))
        chosen = draw.sample(page["keys"], draw.randint(0, len(page["keys"])))
        values = [
            (
                key["key"],
                draw.choice(key["stops"])
                if key["stops"]
                else round(draw.uniform(key["least"], key["most"]))
                if key["whole"]
                else draw.uniform(key["least"], key["most"]),
            )
            for key in chosen
        ]
        trial = draw.choice([0, 1, 7]) if page["kind"] == "trials" else 0
        yield {"scenario": scenario["name"], "shown": shown, "trial": trial, "values": values}


def untried(study):
    """The page's data with every key that it might change: which of them it can doesn't matter here."""
    listed = trial_candidates(study) if isinstance(study, TrialStudy) else candidates(study, False)
    found = AdjustableKeys([Key(candidate, {}, candidate.stops) for candidate in listed])
    pairs = page_runs(study)
    return {
        "kind": "trials" if isinstance(study, TrialStudy) else "speed",
        "motor": None,
        "scenarios": [
            {"name": scenario, "controllers": [controller for _, controller in of_scenario]}
            for scenario, of_scenario in itertools.groupby(pairs, lambda pair: pair[0])
        ],
        "controllers": [
            {"name": name, "baseline": name == study.baseline, "learns": False} for name in study.controller
        ],
        "keys": [_key(study, key) for key in found.keys],
    }


@pytest.mark.parametrize("name", SHIPPED)
def test_the_address_of_any_state_brings_it_back(tmp_path, name):
    page = untried(load(name))
    assert len(page["keys"]) > 5
    for made in there_and_back(tmp_path, page, list(drawn(page, name)))["states"]:
        assert made["after"] == made["before"], made["address"]
        assert not made["after"]["notes"]


@pytest.fixture(scope="module")
def own():
    study = changed(load(MY_MOTOR), {"controller.harmonic.base": 1})
    return data(study, live_studies.found(study, for_own_motor=True), "cogless run x")


def test_keys_that_bound_each_other_come_back_in_any_order(tmp_path, own):
    """Far from the study's motor, where either of L and R would be refused beside the other's first value."""
    (slow, fast), starts = own["motor"]["ends"], {key["key"]: key["start"] for key in own["keys"]}
    far = {name: 8 * starts[name] for name in (RESISTANCE, INDUCTANCE)}
    assert not slow <= 8 <= fast  # R alone
    small = {name: starts[name] / 50 for name in far}
    texts = [
        "#" + "&".join(f"{name}={values[name]!r}" for name in order)
        for values in (far, small)
        for order in itertools.permutations(far)
    ]
    made = there_and_back(tmp_path, own, list(drawn(own, "own")), texts)
    for opened, values in zip(made["opened"], (far, far, small, small), strict=True):
        assert opened["values"] == values and not opened["notes"]
    for state in made["states"]:
        assert state["after"] == state["before"], state["address"]


def test_values_that_no_page_could_have_together_are_left_out_and_told(tmp_path, own):
    starts = {key["key"]: key["start"] for key in own["keys"]}
    clash = f"#{RESISTANCE}={100 * starts[RESISTANCE]!r}&{INDUCTANCE}={starts[INDUCTANCE] / 50!r}"
    alone = f"#{RESISTANCE}={8 * starts[RESISTANCE]!r}"
    made = there_and_back(tmp_path, own, [], [clash, alone])["opened"]
    assert [page["values"] for page in made] == [{}, {}]
    assert [set(page["notes"]) for page in made] == [{RESISTANCE, INDUCTANCE}, {RESISTANCE}]
    for page in made:
        for name, note in page["notes"].items():
            assert "L / R is" in note and note.endswith(f"The value stays at {starts[name]:g}.")
