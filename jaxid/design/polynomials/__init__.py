"""Experiments for polynomial coefficients: amplitudes and experiment points."""
