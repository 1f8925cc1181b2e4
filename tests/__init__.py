"""Tests of jradar; the folders mirror its rooms."""
