"""Tests of `jradar.cli`."""
