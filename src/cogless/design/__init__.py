"""Gains from a stated rule, with the margins that they have."""
