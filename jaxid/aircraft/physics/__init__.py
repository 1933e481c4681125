"""Frames, rotation, mass properties and the rigid body's equations of motion."""
