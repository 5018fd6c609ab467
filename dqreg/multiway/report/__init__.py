"""The report of a multiway registration: page, figures and tables."""
