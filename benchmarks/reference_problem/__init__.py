"""The reference problem of speed: one aircraft in output error, by many programs; see `problem`."""
