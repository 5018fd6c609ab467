"""The answer of a registration: pose, covariance, verdict; its files, its views, and what is measured from it."""
