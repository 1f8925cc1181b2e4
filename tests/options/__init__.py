"""Tests of the options that the library and the command line share."""
