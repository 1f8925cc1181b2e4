"""Paths of a radar's signal through a scene."""
