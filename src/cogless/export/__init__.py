"""A controller of a study as it goes into firmware or into another simulator."""
