"""Clouds and poses to voxel maps, and the model of maps."""
