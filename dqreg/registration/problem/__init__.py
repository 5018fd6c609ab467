"""Source and target as the loop takes them: read, in one unit, centred, prepared and indexed."""
