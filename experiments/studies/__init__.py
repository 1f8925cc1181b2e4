"""Studies beside the experiments: a command each."""
