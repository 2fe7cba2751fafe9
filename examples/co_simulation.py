"""The controller's FMU and the drive's FMU in one loop, under FMPy, as any other simulator would run them.

First: cogless export examples/smallest.toml --controller pi-ilc --to fmu -o results/fmu
"""

import argparse
import math
import zipfile

import fmpy
import numpy as np
from fmpy.fmi3 import FMU3Slave

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("folder", help="where the FMUs are")
arguments.add_argument("--controller", default="pi-ilc")
arguments.add_argument("--seconds", type=float, default=0.5)
options = arguments.parse_args()
if not 0 < options.seconds < math.inf:
    arguments.error(f"--seconds: {options.seconds}: expected a time above zero")


def instance(part: str, start: dict[str, bool]) -> tuple[FMU3Slave, dict[str, int], float]:
    """An FMU at time zero, the value references of its variables, and its period, s."""
    path = f"{options.folder}/{options.controller}-{part}-fmi3.fmu"
    if not zipfile.is_zipfile(path):
        arguments.error(f"{path}: no such FMU: cogless export --to fmu makes it")
    about = fmpy.read_model_description(path)
    fmu = FMU3Slave(
        instanceName=part,
        guid=about.guid,
        unzipDirectory=fmpy.extract(path),
        modelIdentifier=about.coSimulation.modelIdentifier,
    )
    fmu.instantiate()
    places = {variable.name: variable.valueReference for variable in about.modelVariables}
    for name, value in start.items():
        fmu.setBoolean([places[name]], [value])
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    return fmu, places, float(about.defaultExperiment.stepSize)


# the duties that come in act, not those of the controller inside
drive, of_drive, period = instance("drive", {"external_control": True})
controller, of_controller, _ = instance("controller", {})

wires = [
    name
    for name in of_controller
    if name.startswith(("measured.", "reference.")) and name != "reference.learn"
]
to_drive = [of_drive[name] for name in ("duty_a", "duty_b", "duty_c")]
from_controller = [of_controller[name] for name in ("duty_a", "duty_b", "duty_c")]
from_drive, to_controller = [of_drive[name] for name in wires], [of_controller[name] for name in wires]

speed = []
for n in range(round(options.seconds / period)):
    speed += drive.getFloat64([of_drive["omega_m"]])
    # both get what the other gave before, then both step: the controller's output acts one period later
    measured, duty = drive.getFloat64(from_drive), controller.getFloat64(from_controller)
    controller.setFloat64(to_controller, measured)
    drive.setFloat64(to_drive, duty)
    controller.doStep(n * period, period)
    drive.doStep(n * period, period)

rpm = np.array(speed[-round(0.1 / period) :]) * 60 / (2 * np.pi)
print(f"speed after {options.seconds:g} s: {rpm.mean():.2f} rpm, {np.ptp(rpm):.3f} rpm peak to peak")
for fmu in (drive, controller):
    fmu.terminate()
    fmu.freeInstance()
