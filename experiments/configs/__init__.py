"""One file per experiment. `default` contains every field; others change a few."""
