"""Parts of an aircraft: aerodynamics, engines, actuators and control system."""
