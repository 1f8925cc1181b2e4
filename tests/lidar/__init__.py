"""Tests of the LiDAR's preparation."""
