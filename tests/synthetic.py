"""A study and results made by formula, for what needs results but no simulator."""

import numpy as np

from cogless.results import Results, Run
from cogless.simulate import measure
from cogless.study import load
from cogless.study.controller import TERMS
from cogless.study.metric import SIGNALS
from cogless.trace import Trace

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
[drive.rates]
current_loop = "15 kHz"
speed_loop = "1 kHz"
[drive.current_loop]
bandwidth = "800 Hz"
current_limit = "3 A"
[drive.inverter]
bus_voltage = "310 V"
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
# Of each controller: speed ripple in rpm of electrical orders 1, 2, 6 before and after, dip, time constant.
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
    signals = dict.fromkeys([*SIGNALS], 0 * t)
    signals |= {"theta_m": theta, "omega_ref": 60 * RPM + 0 * t, "omega_m": (base + ripple + sag) * RPM}
    signals |= {"i_q": i_q, "i_q_ref": i_q, "tau_e": 0.41 * i_q, "tau_cogging": 0.004 * np.sin(24 * theta)}
    signals |= {"term_integral": load / 0.41, "term_proportional": 0.015 * ripple}
    if "term_ilc" in TERMS[the_study.controller[controller].law]:
        signals["term_ilc"] = 0.02 * (1 - fade) * np.cos(24 * theta)
    kept = [n for n in signals if n not in ("omega_error", "i_amplitude", "tau_motor")]
    kept = [n for n in kept if not n.startswith("term_") or n in TERMS[the_study.controller[controller].law]]
    units = ("s", *(SIGNALS[n].unit for n in kept))
    return Trace(("time", *kept), units, np.column_stack([t, *(signals[n] for n in kept)]))


def results(the_study, rate=15_000, interrupted=False):
    runs = []
    for scenario in the_study.scenario:
        for controller in the_study.controllers_in(scenario):
            recorded = trace(the_study, scenario, controller, rate)
            angle = 2 * np.pi * np.arange(256) / 256
            learnt = {"angle": angle, "current": 0.02 * np.cos(6 * angle), "frame": "electrical"}
            memory = learnt if controller == "pi-ilc" else {}
            runs.append(Run(scenario, controller, recorded, memory, measure(the_study, scenario, recorded)))
    return Results(the_study, runs, interrupted)
