"""What a pose is judged by: sums over patches, rays, boundaries, gaps."""
