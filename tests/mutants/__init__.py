"""Mutants: small faults, one at a time, to see whether a test notices (docs/contributing.md)."""
