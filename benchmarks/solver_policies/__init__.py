"""Convergence of the report's fixes and of SciPy from many starts."""
