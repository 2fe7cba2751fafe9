"""An FMU under FMPy, with one interface for FMI 2.0 and 3.0: values by name, and a whole run."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave
from numpy.typing import NDArray

COUNT = itertools.count()
REAL, INTEGER, BOOLEAN = ("Real", "Float64"), ("Integer", "Int32"), ("Boolean",)


class Slave:
    """One instance, at time zero. `folder`: where the FMU is unpacked, shared by all its instances."""

    def __init__(self, folder: Path, start: dict[str, float] | None = None) -> None:
        about = fmpy.read_model_description(folder, validate=False)
        self.variables = {v.name: v for v in about.modelVariables}
        self.period = float(about.defaultExperiment.stepSize)
        self.version = int(about.fmiVersion[0])
        kind = FMU2Slave if self.version == 2 else FMU3Slave
        self.messages: list[str] = []
        self.fmu: Any = kind(
            instanceName=f"instance{next(COUNT)}",
            guid=about.guid,
            unzipDirectory=str(folder),
            modelIdentifier=about.coSimulation.modelIdentifier,
        )
        if self.version == 2:
            said = fmi2CallbackLoggerTYPE(lambda env, name, status, category, text: self._said(text))
            given = defaultCallbacks
            self.callbacks = fmi2CallbackFunctions(
                said, given.allocateMemory, given.freeMemory, given.stepFinished, None
            )
            self.fmu.instantiate(callbacks=self.callbacks)
        else:
            self.fmu.instantiate(logMessage=lambda env, status, category, text: self._said(text))
        self.initialise(start or {})

    def _said(self, text: bytes) -> None:
        self.messages.append(text.decode())

    def initialise(self, start: dict[str, float]) -> None:
        self.set(**start)
        if self.version == 2:
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=0.0)
        self.fmu.exitInitializationMode()
        self.steps = 0

    def reset(self, start: dict[str, float] | None = None) -> None:
        self.fmu.reset()
        self.initialise(start or {})

    def set(self, **values: float) -> None:
        self.put(values)

    def put(self, values: dict[str, float]) -> None:
        for name, value in values.items():
            variable = self.variables[name]
            reference = [variable.valueReference]
            if variable.type in REAL:
                (self.fmu.setReal if self.version == 2 else self.fmu.setFloat64)(reference, [value])
            elif variable.type in BOOLEAN:
                self.fmu.setBoolean(reference, [bool(value)])
            else:
                raise AssertionError(f"{name}: no input has this type")

    def get(self, names: list[str]) -> list[float]:
        """Values in the order of the names."""
        found: dict[str, float] = {}
        for types, get2, get3 in (
            (REAL, "getReal", "getFloat64"),
            (INTEGER, "getInteger", "getInt32"),
            (BOOLEAN, "getBoolean", "getBoolean"),
        ):
            some = [name for name in names if self.variables[name].type in types]
            if some:
                references = [self.variables[name].valueReference for name in some]
                read = getattr(self.fmu, get2 if self.version == 2 else get3)
                found |= zip(some, read(references), strict=True)
        return [float(found[name]) for name in names]

    def outputs(self) -> list[str]:
        return [name for name, v in self.variables.items() if v.causality == "output"]

    def step(self, periods: int = 1) -> None:
        self.fmu.doStep(self.steps * self.period, periods * self.period)
        self.steps += periods

    def run(self, steps: int, names: list[str]) -> NDArray[np.float64]:
        """Values at each of `steps` communication points, a row each. Ends at the point after them."""
        rows = []
        for _ in range(steps):
            rows.append(self.get(names))
            self.step()
        return np.array(rows)

    def close(self) -> None:
        self.fmu.terminate()
        self.free()

    def free(self) -> None:
        if self.version == 2:
            self.fmu.fmi2FreeInstance(self.fmu.component)  # the library stays: others may use it
        else:
            self.fmu.fmi3FreeInstance(self.fmu.component)
