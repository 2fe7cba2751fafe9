"""Tables that compare Mandra's published values with ours, for docs/studies/mandra2019.md.

    cogless run mandra2019 -o results/mandra2019
    python docs/mandra2019_tables.py --write results/mandra2019/results.json

Without --write the tables are printed. The published values are in this file. Gains and certificates are
those of `cogless design`. Trials and errors come from results.json. The variations are run here (a minute).
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from marked import Blocks, Metrics, main, metrics_of, number, table
from numpy.typing import NDArray

import cogless
from cogless.design.trials.certificate import Gains
from cogless.design.trials.model import Model
from cogless.design.trials.trial_summary import summary, to_dict
from cogless.study import TrialStudy

STEP = 2 * math.pi / 2**14  # of the resolver, rad
STARTS, TRIALS = (1, 31, 61, 91), 500
PHASES = ("start", "31: load", "61: inertia", "91: all three")
LABELS = {
    "ilc": "Fig. 1",
    "ilc-input": "into the input only",
    "ilc-no-integral": "no integral action",
    "no-ilc": "no learning",
}
OBSERVER = {"ilc": "Fig. 1", "observer": "observer"}
# Trials to the floor after the load change: published ones, and those of an independent reproduction.
PUBLISHED = {"ilc": ("4", "2 to 5"), "ilc-input": ("14", "19 to 22")}
FLOORS = (1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)  # resolver steps

NOMINAL = """
title = "The nominal plant of Mandra 2019, as the design has it"
[plant]
model = "discrete"
period = "2.5 ms"
C = [1, 0]
vertex = [{{ A = {A}, B = {B} }}]
[design]
state_weight = [1.8e4, 0.1, 4]
input_weight = 0.9
initial_state = [0.01, 0, 0]
[scenario.moves]
duration = "1 s"
trials = 201
reference = [["0.1 s", 0], ["0.5 s", 1], ["0.9 s", 0]]
load_steps = [[50, 1.0], [200, -1.0], [300, 0.5]]
[controller.ilc]
law = "trial-ilc"
K_s = {K_s}
K_3 = {K_3}
[[metric]]
name = "error"
kind = "rms"
signal = "y_error"
"""

# The state x_3 is the input of the previous sample.
DELAYED = """
title = "A corner of Mandra 2019 with one more sample of delay"
[plant]
model = "discrete"
period = "2.5 ms"
C = [1, 0, 0]
vertex = [{{ A = {A}, B = {B} }}]
input_limit = 30.0
[design]
state_weight = [1, 1, 1, 1]
input_weight = 1
initial_state = [1, 0, 0, 0]
[scenario.moves]
duration = "2.5 s"
trials = 1
reference = [["0 s", 0]]
initial_state = [0.01, 0, 0]
[controller.feedback]
law = "trial-ilc"
learning = false
feedforward = false
K_s = {K_s}
N = 1.0
[[metric]]
name = "error"
kind = "maximum"
signal = "y_error"
"""

Errors = NDArray[np.float64]


def designed() -> dict[str, Any]:
    study = cogless.load("mandra2019")
    assert isinstance(study, TrialStudy)
    return to_dict(study, summary(study))


def gains(design: Mapping[str, Any]) -> list[str]:
    """The results of `cogless design` against the paper's (39) to (42)."""
    ilc, nominal = design["controllers"]["ilc"], design["plant"]["nominal"]
    ahead = np.array(ilc["feedforward"]["numerator"])
    rounded = [*np.round(ahead / ahead[0], 4).tolist(), round(1 / ahead[0], 4)]
    rows = [
        ["vertices", "6 of 8 corners", str(len(design["plant"]["vertices"]))],
        [
            "$A_{av}$: $a_{12}$, $a_{22}$",
            "0.0025, 0.9958",
            _list(nominal["A"][0][1:] + nominal["A"][1][1:], 4),
        ],
        ["$B_{av}$: $b_{21}$", "1.1212", f"{nominal['B'][1]:.4f}"],
        ["$K_s$ (39)", "-99.4484, -0.9270, 1.3916", _list(ilc["K_s"], 4)],
        ["DC gain", "0.01005547", f"{ilc['dc_gain']:.8f}"],
        ["$N$", "99.4484", f"{ilc['N']:.4f}"],
        [
            "(41): coefficients; divisor",
            "1, -0.9564, 0.2352; 0.0028",
            f"{_list(rounded[:3], 4)}; {rounded[3]}",
        ],
        ["$K_3$", "0.6942", f"{ilc['K_3']:.4f}"],
    ]
    return table(["", "paper", "ours"], rows)


def _list(values: Sequence[float], decimals: int) -> str:
    return ", ".join(f"{value:.{decimals}f}" for value in values)


def certificate(design: Mapping[str, Any]) -> list[str]:
    """The certificate of each structure, for the Euler model and for the exactly sampled plant."""
    rows = []
    for name, label in LABELS.items():
        for key, model in (("design_model", "Euler"), ("exactly_sampled", "exact")):
            found = design["controllers"][name]["certificate"][key]
            cells = [
                f"{found['radius_along_the_trial']:.4f}",
                f"{found['radius_with_one_more_sample_of_delay']:.3f}",
            ]
            for filtered in ("without_filter", "with_filter"):
                cells.append(_verdict(found[filtered]))
            plain = found["without_filter"]
            cells.append(f"{plain['largest_K_3']:.3f}" if plain else "-")
            rows.append([f"{label}, {model}", *cells])
    head = ["", "along the trial", "one more sample", "from trial to trial", "filtered", "largest $K_3$"]
    return table(head, rows)


def _verdict(found: Mapping[str, Any] | None) -> str:
    if found is None:
        return "-"
    word = "contracting" if found["contracting"] else "monotone" if found["monotone"] else "may grow"
    return f"{found['norm']:.6g} at {found['norm_at_Hz']:.4g} Hz, {word}"


def count(value: float | None) -> str:
    return "never" if value is None or not math.isfinite(value) else f"{value:.0f}"


def trials(metrics: Metrics) -> list[str]:
    """The number of trials after each change until the RMS error is at two resolver steps."""
    rows = []
    for name, label in LABELS.items():
        ours = metrics["table-1", name]["trials_to_floor"]
        rows.append([label, *PUBLISHED.get(name, ("-", "-")), *(count(n) for n in ours)])
    return table(["", "31: paper", "31: reproduction", *PHASES], rows)


def errors(metrics: Metrics) -> list[str]:
    """The RMS error in the first trial and over the second half of each phase."""
    rows = []
    for name, label in LABELS.items():
        here = metrics["table-1", name]
        for key, text in (("first_error_rad", "first trial"), ("final_error_rad", "second half")):
            rows.append([f"{label}: {text}", *(number(x / STEP) for x in here[key])])
    return table(["RMS, resolver steps", *PHASES], rows)


def to_floor(rms: Errors, floor: float) -> str:
    """The number of trials after the load change until the RMS is at the floor, in resolver steps."""
    below = np.flatnonzero(rms[30:60] <= floor * STEP)
    return str(below[0] + 1) if len(below) else "never"


def observer(metrics: Metrics) -> list[str]:
    """Fig. 1 and the law with an observer: trials to the floor, first and later errors in resolver steps."""
    rows = []
    for name, label in OBSERVER.items():
        here = metrics["table-1", name]
        rows.append([f"{label}: trials to the floor", *(count(n) for n in here["trials_to_floor"])])
        for key, text in (("first_error_rad", "first trial"), ("final_error_rad", "second half")):
            rows.append([f"{label}: {text}, RMS", *(number(x / STEP) for x in here[key])])
    return table(["resolver steps", *PHASES], rows)


def observer_design(design: Mapping[str, Any]) -> list[str]:
    """The rule's gains for the law with an observer, and the certificate over exactly sampled plants."""
    found = design["controllers"]["observer"]
    told, plants = found["observer"], found["certificate"]["design_model"]
    rows = [
        ["pole $p$", f"{told['pole']:.2f}"],
        ["response $g$ [rad/A]", f"{told['response']:.3e}"],
        ["cut-off of $Q$ [Hz]", f"{told['cutoff_Hz']:.1f}"],
        ["along the trial", f"{plants['radius_along_the_trial']:.4f}"],
        ["one more sample", f"{plants['radius_with_one_more_sample_of_delay']:.3f}"],
        ["from trial to trial, filtered", _verdict(plants["with_filter"])],
        ["with the ends", f"{plants['growth_with_the_trial_s_ends']:.3f}"],
    ]
    return table(["", ""], rows)


def observer_loop() -> list[str]:
    """Fig. 1 and the law with an observer with real current loops."""
    rows = []
    for text, changes in current_loops():
        found = {r.controller: r.metrics for r in run(changes, list(OBSERVER))}
        cells = []
        for name in OBSERVER:
            cells.append(", ".join(count(n) for n in found[name]["trials_to_floor"]))
            cells.append(f"{found[name]['first_error_rad'][1] / STEP:.1f}")
        rows.append([text, *cells])
    head = [text for label in OBSERVER.values() for text in (f"{label}: trials", "trial 31, steps")]
    return table(["current loop", *head], rows)


def floors(metrics: Metrics) -> list[str]:
    rows = []
    for name in ("ilc", "ilc-input"):
        rms = np.array(metrics["table-1", name]["error_rms_rad"])
        rows.append([LABELS[name], *(to_floor(rms, floor) for floor in FLOORS)])
    return table(["floor, resolver steps", *(f"{floor:g}" for floor in FLOORS)], rows)


def run(changes: Mapping[str, Any], controllers: Sequence[str]) -> list[Any]:
    study = cogless.load("mandra2019", changes)
    return list(cogless.run_study(study, [f"table-1/{name}" for name in controllers], jobs=2).runs)


def variations() -> list[str]:
    """Trials to the floor after the load change, for variations of the structure into the input only."""
    here = "controller.ilc-input"
    K_1 = [-99.4484, -0.927]
    load = "scenario.table-1.changes.0.load_steps"
    cases: list[tuple[str, dict[str, Any]]] = [
        ("as shipped", {}),
        ("reference at rest", {"scenario.table-1.reference": [["0 s", "0 rev"]]}),
        ("ideal sensor", {"drive.position_sensor": {"kind": "ideal"}}),
        ("filter of 10 Hz", {f"{here}.q_filter.cutoff": "10 Hz"}),
        ("filter of 150 Hz", {f"{here}.q_filter.cutoff": "150 Hz"}),
        ("filter on the signal", {f"{here}.q_filter.acts_on": "signal"}),
        ("load from sample 300 on", {load: [[300, "1.11 N*m"]]}),
        ("load from sample 500 on", {load: [[500, "1.11 N*m"]]}),
        ("$K_2$ halved", {f"{here}.K_s": [*K_1, 0.6958], f"{here}.K_3": 0.6942}),
        ("$K_2$ doubled", {f"{here}.K_s": [*K_1, 2.7832], f"{here}.K_3": 0.6942}),
        ("$K_3$ = 0.5", {f"{here}.K_3": 0.5}),
        ("$K_3$ = 1", {f"{here}.K_3": 1.0}),
        ("$K_3$ = 1.2", {f"{here}.K_3": 1.2}),
        ("$v$ in place of $N v$", {f"{here}.N": 1.0, f"{here}.K_3": 0.6942}),
    ]
    rows = []
    for text, changes in cases:
        (found,) = run(changes, ["ilc-input"])
        rms = np.array(found.metrics["error_rms_rad"])
        K_2 = changes.get(f"{here}.K_s", [1.3916])[-1]
        N = changes.get(f"{here}.N", 99.4484)
        moved = changes.get(f"{here}.K_3", 0.6942) * N / K_2
        rows.append([text, f"{moved:.1f}", *(to_floor(rms, floor) for floor in (2.0, 4.0, 6.0))])
    return table(["", "samples a trial", "to 2 steps", "to 4 steps", "to 6 steps"], rows)


def moving(shown: Sequence[int] = (1, 2, 3, 4, 5, 6)) -> list[str]:
    """Where in a trial the error from the load is, for the first trials after its change, without motion."""
    (found,) = run(
        {"scenario.table-1.reference": [["0 s", "0 rev"]], "drive.position_sensor": {"kind": "ideal"}},
        ["ilc-input"],
    )
    error = found.trace["theta_error"].reshape(TRIALS, -1)
    at = np.arange(error.shape[1])
    rows = []
    for trial in shown:
        e = error[29 + trial]
        rows.append(
            [
                str(trial),
                f"{(at * e).sum() / e.sum():.1f}",
                f"{e.sum():.3f}",
                number(np.sqrt(np.mean(e**2)) / STEP),
            ]
        )
    return table(["trial after the change", "centre, sample", "sum over the trial [rad]", "RMS, steps"], rows)


def current_loops() -> list[tuple[str, dict[str, Any]]]:
    """Changes of the study for an ideal current loop and real ones, with a name for each."""
    limit = {"current_limit": "30 A"}
    cases: list[tuple[str, dict[str, Any]]] = [("ideal", {})]
    for bandwidth in ("1600 Hz", "800 Hz", "400 Hz"):
        for delay, told in enumerate(("", ", a period of computation")):
            changes = {
                "drive.current_loop": {"bandwidth": bandwidth, **limit},
                "drive.inverter": {"bus_voltage": "560 V", "computation_delay": delay},
            }
            cases.append((f"{bandwidth}{told}", changes))
    return cases


def real_loop() -> list[str]:
    """Results with real current loops, and with longer windows over which the speed is averaged."""
    cases = current_loops()
    cases += [
        (f"ideal, window of {window} ({window / 8:g} ms)", {"drive.position_sensor.window": window})
        for window in (20, 24)
    ]
    rows = []
    for text, changes in cases:
        found = {r.controller: r.metrics for r in run(changes, ["ilc", "no-ilc"])}
        ilc, alone = found["ilc"], found["no-ilc"]
        floor = ", ".join(count(n) for n in ilc["trials_to_floor"])
        settled = [f"{ilc['final_error_rad'][k] / STEP:.2f}" for k in (1, 3)]
        rows.append([text, floor, *settled, f"{alone['first_error_rad'][1] / STEP:.1f}"])
    head = [
        "current loop",
        "Fig. 1: trials to the floor",
        "31 to 60, steps",
        "91 to 500, steps",
        "no learning, 31, steps",
    ]
    return table(head, rows)


def delayed(design: Mapping[str, Any]) -> list[str]:
    """The largest error at each vertex of the Euler model, as designed and with the input a sample later."""
    K_s = design["controllers"]["ilc"]["K_s"]
    law = Gains(np.array(K_s[:2]), K_s[2], 1.0, False, True)
    rows = []
    for vertex in design["plant"]["vertices"]:
        (_, a), (_, c) = vertex["A"]
        cells = []
        for b, B in ((0.0, [0.0, vertex["B"][1], 0.0]), (vertex["B"][1], [0.0, 0.0, 1.0])):
            A = [[1.0, a, 0.0], [0.0, c, b], [0.0, 0.0, 0.0]]
            found = _small(DELAYED.format(A=A, B=B, K_s=[*K_s[:2], 0.0, K_s[2]]))
            cells.append(number(found["error"][0]))
        at = (
            vertex["at"]
            .replace("mechanics.", "")
            .replace("motor.", "")
            .replace("viscous_friction", "friction")
        )
        pole = law.delayed(Model.of(vertex["A"], vertex["B"]), np.array([1.0, 0.0]))
        rows.append([at, *cells, f"{pole:.3f}"])
    head = ["Euler's model, largest error [rad]", "as designed", "a sample later", "largest pole then"]
    return table(head, rows)


def contraction(design: Mapping[str, Any]) -> list[str]:
    """The decay of the error from trial to trial, on the noise-free nominal plant in double precision."""
    ilc, nominal = design["controllers"]["ilc"], design["plant"]["nominal"]
    found = _small(NOMINAL.format(**nominal, K_s=ilc["K_s"], K_3=ilc["K_3"]))["error"]
    rows = []
    for trial in (2, 10, 50, 100, 150, 200):
        rows.append([str(trial), f"{found[trial - 1]:.2e}", f"{found[trial] / found[trial - 1]:.4f}"])
    factor = ilc["certificate"]["design_model"]["without_filter"]["norm_of_the_nominal_plant"]
    return [*table(["trial", "RMS [rad]", "next over this"], [*rows, ["certified", "", f"{factor:.4f}"]])]


def _small(text: str) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "study.toml"
        path.write_text(text, encoding="utf-8")
        (found,) = cogless.run_study(cogless.load(path)).runs
    return dict(found.metrics)


def precision() -> list[str]:
    rows = []
    for sensor in ("resolver", "ideal"):
        for name in ("single", "double"):
            changes: dict[str, Any] = {"drive.precision": name}
            if sensor == "ideal":
                changes["drive.position_sensor"] = {"kind": "ideal"}
            (found,) = run(changes, ["ilc"])
            rows.append(
                [f"{sensor} sensor, {name}", *(number(1e3 * x) for x in found.metrics["final_error_rad"])]
            )
    return table(["RMS in the second half [mrad]", *PHASES], rows)


def blocks(path: Path) -> Blocks:
    metrics, design = metrics_of(path), designed()
    return {
        "gains": gains(design),
        "certificate": certificate(design),
        "trials": trials(metrics),
        "errors": errors(metrics),
        "observer": observer(metrics),
        "observer-design": observer_design(design),
        "observer-loop": observer_loop(),
        "floors": floors(metrics),
        "moving": moving(),
        "variations": variations(),
        "real-loop": real_loop(),
        "delayed": delayed(design),
        "contraction": contraction(design),
        "precision": precision(),
    }


if __name__ == "__main__":
    main(Path(__file__).parent / "studies" / "mandra2019.md", blocks)
