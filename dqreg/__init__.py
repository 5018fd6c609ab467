"""Registers scans to CAD meshes and clouds."""
