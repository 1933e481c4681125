"""Benchmarks: each prints one table with ratios measured in one run, and with `--json` one JSON
object.
"""
