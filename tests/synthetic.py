"""A study and results made by formula, for what needs results but no simulator."""

import numpy as np

from cogless.control_library import C_LAWS
from cogless.design.trials.from_study import design_study
from cogless.results import Results, Run, TrialResults
from cogless.results.trace import Trace
from cogless.run.carry_out import measure
from cogless.signals import DERIVED
from cogless.study import load
from cogless.study.metric import SIGNAL_DIMENSIONS

STUDY = """
title = "Torque ripple at 60 r/min"
description = "A small motor with cogging, under three controllers. Made by formula, not simulated."
seed = 7
[[assumption]]
about = "mechanics.inertia"
reason = "Not in the datasheet; taken so that the published dip comes out."
[[assumption]]
about = "drive.current_loop"
reason = "The printed gains are 20 times too slow for the published step."
[trace]
rate = "15 kHz"
[motor]
pole_pairs = 4
R_s = "15.42 ohm"
L_d = "30 mH"
L_q = "30 mH"
psi_f = "68 mWb"
rated_torque = "0.637 N*m"
flux_harmonics = [ {order = 6, d = "1 mWb"} ]
cogging = [ {order = 24, torque = "4 mN*m"}, {order = 18, torque = "2 mN*m", phase = "30 deg"} ]
[mechanics]
inertia = "2.5e-4 kg*m^2"
[drive]
rates = { current_loop = "15 kHz", speed_loop = "1 kHz" }
current_loop = { bandwidth = "800 Hz", current_limit = "3 A" }
inverter = { bus_voltage = "310 V" }
[scenario.low-speed]
duration = "10 s"
reference = "60 rpm"
[scenario.step-on]
duration = "4 s"
reference = "60 rpm"
initial_speed = "60 rpm"
events = [ {time = "2 s", load = "0.6 N*m"} ]
[controller.pi]
law = "pi"
kp = "0.015 A/rpm"
ki = "0.3 A/rpm/s"
label = "PI as published"
baseline = true
[controller.fair-pi]
law = "pi"
tuning = {rule = "phase-margin", phase_margin = "60 deg"}
label = "PI re-tuned"
[controller.pi-ilc]
law = "pi-ilc"
kp = "0.015 A/rpm"
ki = "0.3 A/rpm/s"
gain = "0.004 A/rpm"
memory = "angle"
label = "PI-ILC"
[[metric]]
name = "speed_orders"
kind = "order"
signal = "omega_m"
order = [1, 2, 6]
frame = "electrical"
window = ["8 s", "10 s"]
scenarios = ["low-speed"]
unit = "rpm"
[[metric]]
name = "speed_ripple"
kind = "peak-to-peak"
signal = "omega_m"
window = ["8 s", "10 s"]
scenarios = ["low-speed"]
unit = "rpm"
[[metric]]
name = "torque_ripple"
kind = "ripple-rms"
signal = "tau_e"
window = ["8 s", "10 s"]
scenarios = ["low-speed"]
unit = "mN*m"
[[metric]]
name = "copper_loss"
kind = "copper-loss"
window = ["2 s", "4 s"]
[[metric]]
name = "chattering"
kind = "chattering"
window = ["2 s", "4 s"]
unit = "mA"
[[metric]]
name = "dip"
kind = "dip"
event = "2 s"
unit = "rpm"
[[metric]]
name = "settling"
kind = "settling"
event = "2 s"
band = "2 rpm"
"""

RPM = 2 * np.pi / 60
# By controller: ripple of the electrical orders 1, 2, 6 before and after, rpm; dip, rpm; time constant, s.
CHARACTER = {
    "pi": ((0.9, 0.4, 4.8), (0.9, 0.4, 4.8), 44, 0.25),
    "fair-pi": ((0.5, 0.2, 1.9), (0.5, 0.2, 1.9), 30, 0.12),
    "pi-ilc": ((0.9, 0.4, 4.8), (0.1, 0.06, 0.46), 36, 0.3),
}


def study(folder, text=STUDY):
    path = folder / "synthetic.toml"
    path.write_text(text)
    return load(path)


def trace(the_study, scenario, controller, rate=15_000):
    """A run's signals by formula, with ripple that fades from "before" to "after" within a second."""
    before, after, dip, tau = CHARACTER[controller]
    described = the_study.scenario[scenario]
    t = np.arange(round(described.duration * rate)) / rate
    start = 0 if described.initial_speed == 0 else 60
    base = 60 + (start - 60) * np.exp(-t / 0.05)
    theta = np.cumsum(base * RPM) / rate
    fade = np.exp(-t / 1.0)
    ripple = sum(
        (a + (b - a) * fade) * np.cos(4 * n * theta + n)
        for n, b, a in zip((1, 2, 6), before, after, strict=True)
    )
    ripple = ripple + 0.3 * np.cos(18 * theta)
    since = [t - event.time for event in described.events]
    sag = sum(np.where(s < 0, 0, -dip * 4 * (np.exp(-s / tau) - np.exp(-s / (tau / 3)))) for s in since)
    load = sum(np.where(s < 0, 0, 0.6 * (1 - np.exp(-s / 0.03))) for s in since) + 0 * t
    noise = np.repeat(np.random.default_rng(1).normal(size=len(t) // 15 + 1), 15)[: len(t)]
    i_q = load / 0.41 + 0.02 * np.cos(24 * theta) + 0.004 * noise
    signals = dict.fromkeys([*SIGNAL_DIMENSIONS], 0 * t)
    signals |= {"theta_m": theta, "omega_ref": 60 * RPM + 0 * t, "omega_m": (base + ripple + sag) * RPM}
    signals |= {"i_q": i_q, "i_q_ref": i_q, "tau_e": 0.41 * i_q, "tau_cogging": 0.004 * np.sin(24 * theta)}
    signals |= {"term_integral": load / 0.41, "term_proportional": 0.015 * ripple}
    terms = {term.signal for term in C_LAWS[the_study.controller[controller].law].terms}
    if "term_ilc" in terms:
        signals["term_ilc"] = 0.02 * (1 - fade) * np.cos(24 * theta)
    signals |= {"theta_measured": theta, "omega_measured": signals["omega_m"]}
    kept = [n for n in signals if n not in DERIVED]
    kept = [n for n in kept if not n.startswith("term_") or n in terms]
    units = ("s", *(SIGNAL_DIMENSIONS[n].unit for n in kept))
    return Trace(("time", *kept), units, np.column_stack([t, *(signals[n] for n in kept)]))


def results(the_study, rate=15_000, interrupted=False):
    runs = []
    for scenario in the_study.scenario:
        for controller in the_study.controllers_in(scenario):
            recorded = trace(the_study, scenario, controller, rate)
            angle = 2 * np.pi * np.arange(256) / 256
            learned = {"angle": angle, "current": 0.02 * np.cos(6 * angle), "frame": "electrical"}
            memory = learned if controller == "pi-ilc" else {}
            runs.append(Run(scenario, controller, recorded, memory, measure(the_study, scenario, recorded)))
    return Results(the_study, runs, interrupted)


TRIALS = """
title = "A shaft moved from point to point"
description = "Made by formula, not simulated."
seed = 11
[[assumption]]
about = "scenario.move.reference"
reason = "The motion is not in the text."
[motor]
pole_pairs = 3
R_s = "1 ohm"
L_d = "5 mH"
L_q = "5 mH"
K_t = "0.37 N*m/A"
[mechanics]
inertia = "5.9e-4 kg*m^2"
viscous_friction = "1.4e-3 N*m*s/rad"
[drive]
rates = { current_loop = "8 kHz", position_loop = "400 Hz" }
current_loop = { kind = "ideal", current_limit = "10 A" }
[design]
state_weight = [1.8e4, 0.1, 4]
input_weight = 0.9
initial_state = [0.01, 0, 0]
[design.range]
"mechanics.inertia" = ["5.9e-4 kg*m^2", "10.6e-4 kg*m^2"]
[scenario.move]
duration = "0.25 s"
trials = 60
reference = [["0.05 s", "0 rad"], ["0.2 s", "1 rad"]]
[[scenario.move.changes]]
trial = 21
load_steps = [[40, "0.5 N*m"]]
[[scenario.move.changes]]
trial = 41
reference = [["0.05 s", "0 rad"], ["0.2 s", "2 rad"]]
override = { "mechanics.inertia" = "10.6e-4 kg*m^2" }
[controller.none]
law = "trial-ilc"
label = "no learning"
baseline = true
learning = false
K_s = [-99.4, -0.927, 1.39]
[controller.ilc]
law = "trial-ilc"
label = "ILC, Fig. 1"
K_s = [-99.4, -0.927, 1.39]
K_3 = 0.694
q_filter = { cutoff = "30 Hz" }
[controller.input]
law = "trial-ilc"
label = "ILC into the input"
acts_on = "input"
K_s = [-99.4, -0.927, 1.39]
K_3 = 0.694
[[metric]]
name = "error_rms"
kind = "rms"
signal = "theta_error"
unit = "mrad"
[[metric]]
name = "to_floor"
kind = "trials-to-floor"
signal = "theta_error"
floor = "1 mrad"
[[metric]]
name = "first_error"
kind = "first-rms"
signal = "theta_error"
unit = "mrad"
[[metric]]
name = "peak"
kind = "maximum"
signal = "theta_error"
unit = "mrad"
"""

FLOOR = 0.5e-3  # rad
# By controller: the error's RMS in each phase's first trial, rad, and its factor from trial to trial.
LEARNING = {
    "none": ((3e-3, 6e-3, 5e-3), 1.0),
    "ilc": ((3e-3, 6e-3, 8e-3), 0.3),
    "input": ((3e-3, 30e-3, 8e-3), 0.8),
}


def rms_of_trials(the_study, controller, scenario="move"):
    """RMS of the error in each trial, rad."""
    first, factor = LEARNING[controller]
    described = the_study.scenario[scenario]
    bounds = (*described.starts, described.trials + 1)
    phases = [x * factor ** np.arange(b - a) for x, a, b in zip(first, bounds, bounds[1:], strict=False)]
    rms = np.concatenate(phases)
    return rms if factor == 1 else np.hypot(rms, FLOOR)


def trial_trace(the_study, rms, scenario="move", learns=True):
    """A run whose error is a sine of this RMS in each trial."""
    described, samples = the_study.scenario[scenario], the_study.samples(scenario)
    p, period = np.arange(samples), the_study.period
    phases = np.searchsorted(described.starts, np.arange(1, described.trials + 1), side="right") - 1
    plans = [the_study.reference(scenario, here) for _, here in described.phases]
    reference = np.concatenate([plans[k] for k in phases])
    error = np.outer(rms, np.sqrt(2) * np.sin(2 * np.pi * p / samples)).ravel()
    learned = np.outer(np.arange(described.trials) * learns, np.cos(2 * np.pi * p / samples)).ravel() * 1e-4
    signals = {
        "time": (period * np.arange(samples * described.trials), "s"),
        "trial": (np.repeat(np.arange(1.0, described.trials + 1), samples), ""),
        "theta_m": (reference - error, "rad"),
        "theta_ref": (reference, "rad"),
        "i_q_ref": (20 * error, "A"),
        "learned": (learned, "rad"),
    }
    units = tuple(unit for _, unit in signals.values())
    return Trace(tuple(signals), units, np.column_stack([x for x, _ in signals.values()]))


def trial_run(the_study, controller, rms, design=None, scenario="move"):
    recorded = trial_trace(the_study, rms, scenario, controller != "none")
    metrics = measure(the_study, scenario, recorded)
    return Run(scenario, controller, recorded, {}, metrics, design)


def trial_results(the_study, rms=None, designed=True, controllers=None):
    """Results of a study of trials. `rms`: by controller, the error in each trial in place of the formula."""
    names = controllers or list(the_study.controllers_in("move"))
    designs = design_study(the_study, [("move", name) for name in names]) if designed else {}
    return TrialResults(
        the_study,
        [
            trial_run(
                the_study,
                name,
                (rms or {}).get(name, rms_of_trials(the_study, name)),
                designs.get(("move", name)),
            )
            for name in names
        ],
    )
