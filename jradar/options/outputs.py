"""Formats of clouds and of all frames together, by the suffixes of their files."""

CLOUDS = ("ply", "pcd", "csv")
STREAMS = (".mcap", ".ros2", ".mp4", ".gif")  # all frames in one file or bag
