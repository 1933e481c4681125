"""Likelihoods of models with process noise: Kalman filter, innovation form, smoother."""
