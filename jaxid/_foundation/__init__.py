"""What every floor uses: axis names, the status enumeration, checks of input, triangular factors."""
