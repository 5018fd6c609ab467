"""Inspection plans: what a plan file asks for, and what it measures on a scan."""
