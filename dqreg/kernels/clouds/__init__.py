"""What neighbouring points tell: planes, quadrics, rims, lines, spreads."""
