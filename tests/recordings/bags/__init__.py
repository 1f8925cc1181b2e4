"""Tests of `jradar.recordings.bags`."""
