"""Other poses that may fit as well: proposed, refined and compared, before any verdict."""
