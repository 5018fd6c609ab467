"""The pose graph: edges, their loops, and the poses that explain them best."""
