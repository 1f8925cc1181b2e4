"""Files of parameters, and published weights to start from."""
