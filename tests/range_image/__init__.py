"""Tests of `jradar.range_image`."""
