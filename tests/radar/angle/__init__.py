"""Tests of `jradar.radar.angle`."""
