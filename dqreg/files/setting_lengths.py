"""Which settings of a result are lengths, or places, in the target's unit: the others are the same in any."""

# Above zero.
SIZES = ("max_distance", "reach", "diagonal")
# Zero or above; None where the data have none.
DISTANCES = ("width", "source_noise", "source_spacing", "cell_size", "chord", "expected_deviation")
SETTING_LENGTHS = (*SIZES, *DISTANCES, "centre")
