"""Signed deviations of a scan from its part: how far, on which side, and their files."""
