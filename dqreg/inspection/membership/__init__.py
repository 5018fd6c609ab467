"""Which points of a scan are of the part, told by its surfaces, their patches and their cells."""
