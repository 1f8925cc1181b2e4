"""Tests of `jradar.training`."""
