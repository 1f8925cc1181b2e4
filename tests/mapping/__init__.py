"""Tests of `jradar.mapping`."""
