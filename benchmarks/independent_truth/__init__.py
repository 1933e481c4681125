"""Studies of records that another simulator has made, of systems that no other benchmark has."""
