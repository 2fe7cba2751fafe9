"""Step motors without a sensor: the ripple of a printer's axis, found with an accelerometer."""
