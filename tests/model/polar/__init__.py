"""Tests of `jradar.planar`."""
