"""Tasks of `experiments.main`: what each one trains and how it is evaluated."""
