"""Whether a part is within its tolerance: by places, by regions, and how much of it was covered."""
