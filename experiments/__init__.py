"""Experiments: each is a config, run by `python -m experiments.main`."""
