"""Detection of missing effects by the loop: `python -m benchmarks.missing_effects`.

Scenarios have one planted effect, two, none, or gusts. A scenario holds the planted effects and the
flight conditions, a system flies it (`spring`, `ship`, `longitudinal`, `f4`, `f16`), `measure`
compares one study with its truth, and `judge` summarises many studies.
"""
