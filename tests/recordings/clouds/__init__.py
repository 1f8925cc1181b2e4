"""Tests of `jradar.recordings.clouds`."""
