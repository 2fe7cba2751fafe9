"""Studies: validated models of motor, drive, mechanics, scenarios, controllers and metrics."""

from cogless.study.reading import changed, for_scenario, load
from cogless.study.study import Study

__all__ = ["Study", "changed", "for_scenario", "load"]
