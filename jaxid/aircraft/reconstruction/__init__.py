"""Flight-path reconstruction: the kinematic model with instrument errors."""
