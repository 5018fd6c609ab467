"""Compiled inner loops: each a plain function of arrays, made machine code by Numba when it is first called.

Modules here import Numba, so other rooms import them inside the functions that need them. Every kernel has a plain twin
or a brute-force oracle in the tests. A kernel over many rows takes a range of them and releases the GIL; `over_chunks`
gives fixed ranges to threads, so that the bits do not depend on how many there are.
"""
