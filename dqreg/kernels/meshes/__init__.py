"""What follows from triangles: their sides, corners, normals, doubles, creases."""
