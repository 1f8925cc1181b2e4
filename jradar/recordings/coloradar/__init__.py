"""Sequences of the ColoRadar data set."""
