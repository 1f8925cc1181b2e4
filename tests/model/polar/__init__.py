"""Tests of `jradar.model.grids.polar`."""
