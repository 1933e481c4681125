"""Input design: measures of information, optimal spectra, signals and experiment points."""
