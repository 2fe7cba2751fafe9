"""Export a study's controller as C: constants, step function, example, and test against the simulation."""
