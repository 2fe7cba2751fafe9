"""Studies: validated models of motor, drive, mechanics, scenarios, controllers and metrics."""

from cogless.study.reading import AnyStudy, changed, for_scenario, load
from cogless.study.speed_study import Study
from cogless.study.trial_study import TrialStudy

__all__ = ["AnyStudy", "Study", "TrialStudy", "changed", "for_scenario", "load"]
