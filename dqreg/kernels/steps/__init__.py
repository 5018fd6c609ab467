"""From correspondences to the next pose: weights, sums of a cost, the pose of least cost."""
