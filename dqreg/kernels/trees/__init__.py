"""Trees of boxes over points and triangles, and what they are asked: what is nearest."""
