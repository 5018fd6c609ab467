"""How well scan and target agree at a pose: what points, their neighbourhoods and other objects say."""
