"""What each task of `experiments.main` does."""
