"""Morton codes, sorting, ranks, and rows put back to their places."""
