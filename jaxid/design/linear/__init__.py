"""Inputs of linear and nearly linear models: optimal spectra and eigenvectors."""
