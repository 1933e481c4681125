"""The atmosphere, wind, turbulence and buffet."""
