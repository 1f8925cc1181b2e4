"""One file per experiment; `default` holds every field, the others differ from it."""
