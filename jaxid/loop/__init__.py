"""The search for missing effects: hypotheses, moves, evidence, assessment."""
