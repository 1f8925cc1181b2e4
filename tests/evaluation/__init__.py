"""Tests of `jradar.evaluation`."""
