"""Design: gains from stated rules, with their stability margins, learning factors and certificates."""
