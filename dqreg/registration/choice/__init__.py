"""Which pose is the result: others are judged where one is in doubt, the best is kept, the rest named."""
