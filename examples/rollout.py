"""Many variations of one study side by side: how much ripple is left over inertia and learning gain."""

import cogless

INERTIAS = ("2e-4 kg*m^2", "3e-4 kg*m^2", "6e-4 kg*m^2")
GAINS = ("0.001 A/rpm", "0.004 A/rpm", "0.008 A/rpm")

study = cogless.load("liu2018", {"trace.rate": "1 kHz"})
variants = [
    cogless.changed(study, {"mechanics.inertia": inertia, "controller.pi-ilc.gain": gain})
    for inertia in INERTIAS
    for gain in GAINS
]
results = cogless.rollout(variants, ["60-rpm/pi-ilc"], keep_traces=False)
left = [result.runs[0].metrics["speed_order_rad_s"][2] for result in results]
print("order 6 [rad/s]", *GAINS, sep="  ")
for row, inertia in enumerate(INERTIAS):
    print(f"{inertia:15}", *(f"{value:11.3f}" for value in left[3 * row : 3 * row + 3]), sep="  ")
