"""Flight records: air data, initial channels, transfer to the centre of gravity, plausibility."""
