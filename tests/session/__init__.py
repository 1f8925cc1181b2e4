"""Tests of `jradar.session`."""
