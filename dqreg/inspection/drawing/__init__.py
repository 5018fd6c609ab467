"""What a drawing asks of features: sizes, distances, zones; and what noise does to them."""
