"""Share of the 95 % intervals that hold the truth, over repeated simulated flights."""
