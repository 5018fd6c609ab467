"""Inspection plans: what a plan file asks for, and a first plan for a part."""
