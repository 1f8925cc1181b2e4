"""Directions of detected cells: FFT and subspaces, folds, near field, deviations."""
