"""Tests of `jradar.model`."""
