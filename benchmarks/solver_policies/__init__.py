"""Convergence of the report's fixes from many starts, beside SciPy."""
