"""Tests of `jradar.pipeline`."""
