"""Scenes: solids of known materials, and what moves among them."""
