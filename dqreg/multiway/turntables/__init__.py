"""Steps of a turntable, and parts that look the same about an axis."""
