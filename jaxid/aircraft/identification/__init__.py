"""Identification models of an aircraft, built from a simulated aircraft or a flight record."""
