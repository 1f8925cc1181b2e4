"""Tests of the task `radarhd`."""
