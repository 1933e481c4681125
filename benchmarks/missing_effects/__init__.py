"""Does the loop find what a model lacks: scenarios with a planted effect, with two, with none, and with gusts.

`python -m benchmarks.missing_effects`; a scenario says what is planted and how it is flown, a system flies it (`spring`, `ship`,
`longitudinal`, `f4`, `f16`), `measure` holds one study against its truth, `judge` puts many studies together.
"""
