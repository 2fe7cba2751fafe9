"""Run studies on the simulation engine: one controller in one scenario, or thousands of runs in parallel."""
