"""Other poses that may fit as well: proposed, refined, compared, and named in the result."""
