"""Tests of `jradar.calibration`."""
