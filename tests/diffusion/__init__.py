"""Tests of `jradar.diffusion`."""
