"""A controller of a study as C: its constants, a step, an example, a test against the simulation."""
