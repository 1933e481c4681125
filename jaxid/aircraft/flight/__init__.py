"""The aircraft in flight: trim, modes, simulation and the report's flights."""
