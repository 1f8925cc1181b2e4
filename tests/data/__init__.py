"""Tests of `jradar.data`."""
