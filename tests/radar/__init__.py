"""Tests of `jradar.radar`."""
