"""Clouds in the cells of a grid: their means, planes and surfaces."""
