"""Formats of clouds and of all frames together, by the suffixes of their files."""

CLOUDS = ("ply", "pcd", "csv")
OF_FILES = (  # names that end so are never taken for folders
    *(".ply", ".pcd", ".csv", ".npz", ".npy", ".las", ".laz", ".xyz", ".obj", ".bin"),
    *(".txt", ".json", ".toml", ".html", ".png", ".jpg", ".bag", ".db3", ".zip"),
)
STREAMS = (".mcap", ".ros2", ".mp4", ".gif")  # all frames in one file or bag
