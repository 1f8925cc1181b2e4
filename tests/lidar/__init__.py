"""Tests of the room `lidar`."""
