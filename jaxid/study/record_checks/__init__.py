"""Findings on records before a model is fitted to them."""
