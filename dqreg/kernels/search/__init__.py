"""Many poses at once: pairs looked up, gains on a grid, refined together."""
