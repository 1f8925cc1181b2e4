"""Tests of jradar.recordings."""
