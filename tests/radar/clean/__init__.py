"""Tests of `jradar.radar.clean`."""
