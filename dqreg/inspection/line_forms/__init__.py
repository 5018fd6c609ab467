"""Roundness and straightness: forms of the lines of a face."""
