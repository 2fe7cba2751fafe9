"""How the ripple depends on inertia, with and without learning."""

import numpy as np

import cogless

study = cogless.load("liu2018", {"trace.rate": "1 kHz"})
for inertia in ("2e-4 kg*m^2", "3e-4 kg*m^2", "6e-4 kg*m^2"):
    variant = cogless.changed(study, {"mechanics.inertia": inertia})
    results = cogless.run_study(variant, ["60-rpm/pi", "60-rpm/pi-ilc"], jobs=2)
    if results.interrupted:  # Ctrl-C
        break
    for run in results.runs:
        order_6 = run.metrics["speed_order_rad_s"][2]
        late = run.trace.window(8.0, 12.0)
        peak = np.ptp(run.trace["omega_m"][late])
        print(f"{inertia:12} {run.controller:7} order 6: {order_6:.3f} rad/s, peak to peak {peak:.2f} rad/s")
