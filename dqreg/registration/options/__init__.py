"""What may be asked of a registration: its options, each checked, and constraints on the pose."""
