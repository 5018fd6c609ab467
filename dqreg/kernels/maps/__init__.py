"""Voxel maps that grow scan by scan, and the points of a sweep."""
