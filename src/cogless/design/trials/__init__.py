"""Design of controllers that learn from trial to trial: docs/theory/trial-design.md."""
