"""Export a study's controller, as C for firmware or as FMU for other simulators."""
