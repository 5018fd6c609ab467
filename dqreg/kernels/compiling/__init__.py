"""How kernels become machine code, where that is kept, and all of them compiled at once."""
