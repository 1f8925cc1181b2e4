"""Tests of jradar.viz."""
