"""Tests of `jradar.options`."""
