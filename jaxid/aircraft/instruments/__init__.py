"""Instruments of an aircraft: channels, geometry, errors and noise levels."""
