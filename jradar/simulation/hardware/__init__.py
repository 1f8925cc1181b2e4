"""What a radar's hardware makes of the paths."""
