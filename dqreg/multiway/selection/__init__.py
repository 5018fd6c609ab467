"""Which edges and which scans the poses rest on."""
