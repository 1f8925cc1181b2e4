"""CFAR detection: the windows, the multipliers, and one cell for each target."""
