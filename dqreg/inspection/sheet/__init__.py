"""A plan carried out on a registered scan: its alignment, the value of each characteristic, the rows of the sheet."""
