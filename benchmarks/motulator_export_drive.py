"""The plain drive in motulator-export, motulator's port to C; prints one JSON line with its CPU times."""

import json
import time

import plain_drive as d
from motulator_drive import build
from motulator_export import native

POINTS = 1  # one row a tick is its fastest setting; the default keeps both ends of each tick


def main() -> None:
    native.Simulation(*build(), show_progress=False).simulate(t_stop=1e-3)  # compiles its library
    simulation = native.Simulation(*build(), show_progress=False)
    start = time.process_time()
    result = simulation.simulate(t_stop=d.DURATION, N_eval=POINTS)
    elapsed = time.process_time() - start
    d.check("motulator-export", result.mdl.mechanics.w_M[-1], result.ctrl.fbk.i_s[-1].imag)

    # its C loop alone, with its logs but without handing them to Python: a private call, so only informative
    system = simulation._system
    assert system is not None
    start = time.process_time()
    system.run(2 * d.DURATION, POINTS)
    core = time.process_time() - start
    print(json.dumps({"ns_per_tick": elapsed / d.TICKS * 1e9, "core_ns_per_tick": core / d.TICKS * 1e9}))


if __name__ == "__main__":
    main()
