"""Tests of `jradar.recordings.points`."""
