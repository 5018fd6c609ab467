"""The scans as they are read, how they overlap, and all of them in one cloud."""
