"""How far a fit can be trusted: what constrains it, how sure it is, and what its verdict rests on."""
