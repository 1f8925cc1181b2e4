"""Tests of `jradar.recordings.coloradar`."""
