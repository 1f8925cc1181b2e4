"""Tests of jradar.outputs."""
