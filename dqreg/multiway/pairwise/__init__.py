"""The registrations of pairs of scans: which, from where, and with what result."""
