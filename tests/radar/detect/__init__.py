"""Tests of `jradar.radar.detect`."""
