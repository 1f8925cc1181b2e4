"""Experiments: a config each, run by `python -m experiments.main`."""
