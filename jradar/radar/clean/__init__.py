"""What is removed before detection: crossing chirps of other radars, and clutter."""
