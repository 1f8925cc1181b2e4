"""Tests of `jradar.baselines`."""
