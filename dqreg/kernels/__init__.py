"""Compiled inner loops: each a plain function of arrays, made machine code by Numba when it is first called.

    compiling/  How kernels become machine code, where that is kept, and all of them compiled at once.
    order/      Morton codes, sorting, ranks, and rows put back to their places.
    trees/      Trees of boxes over points and triangles, and what they are asked: what is nearest.
    meshes/     What follows from triangles: their sides, corners, normals, doubles, creases.
    clouds/     What neighbouring points tell: planes, quadrics, rims, lines, spreads.
    cells/      Clouds in the cells of a grid: their means, planes and surfaces.
    maps/       Voxel maps that grow scan by scan, and the points of a sweep.
    steps/      From correspondences to the next pose: weights, sums of a cost, the pose of least cost.
    search/     Many poses at once: pairs looked up, gains on a grid, refined together.
    evidence/   What a pose is judged by: sums over patches, rays, boundaries, gaps.

`threads` gives ranges of rows to threads and knows the deadline; `kept` holds what is made once. Modules here import
Numba, so other rooms import them inside the functions that need them. Every kernel has a plain twin or a brute-force
oracle in the tests. A kernel over many rows takes a range of them and releases the GIL; `over_chunks` gives fixed
ranges to threads, so that the bits do not depend on how many there are.
"""
