"""The joint refinement of all poses on the planes of the scans, and their covariance."""
