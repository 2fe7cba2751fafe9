"""Below the studies: one run-in, then many load steps from copies of the state that it ends in."""

import cogless
from cogless import _simulator_f64 as engine
from cogless.run.drive_config import engine_config

LOADS = (0.1, 0.2, 0.3, 0.4)  # N m

config = engine_config(cogless.load("liu2018", {"drive.precision": "double"}), "60-rpm", "pi-ilc")
rate = config["drive"]["current_rate"]

drive = engine.Drive(config)
state = drive.start()
drive.advance(state, engine.Recorder(drive, rate), 5 * rate)  # 5 s to learn

column = [name for name, unit in drive.signals].index("omega_m")
for load in LOADS:  # 10 ms after the copy was made
    stepped = engine.Drive({**config, "events": [{"time": 5.01, "load": load}]})
    recorder = engine.Recorder(stepped, 15)
    stepped.advance(state.copy(), recorder, rate // 2)
    print(f"{load} N m: down to {recorder.take()[:, column].min():.2f} rad/s")
