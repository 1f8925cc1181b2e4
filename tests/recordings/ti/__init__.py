"""Tests of `jradar.recordings.ti`."""
