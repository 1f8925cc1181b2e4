"""A video of frames: radar, jradar and LiDAR from above, side by side.

    walk.mp4      needs ffmpeg
    walk.gif      needs nothing, and is larger

Forward is up. Colour shows the height, and red is high. All frames have the limits of
the first.
"""

import os
from pathlib import Path

import numpy as np
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jradar.errors import UsageError
from jradar.outputs.published import Published
from jradar.types import PointCloud

PANELS = {"radar": 8.0, "enhanced": 0.6, "lidar": 0.6}  # and the area of a point
TITLES = {"enhanced": "jradar", "lidar": "LiDAR"}
FRAMES_PER_SECOND = 10
STRONG = 4.0  # times the noise: weaker radar points are left out
HEIGHTS_M = (-1.0, 2.0)


class VideoWriter:
    """A video of ten frames a second, which appears when it is complete."""

    def __init__(self, path: Path):
        """Raise UsageError for an .mp4 without ffmpeg."""
        if path.suffix == ".mp4" and not FFMpegWriter.isAvailable():
            raise UsageError(f"{path} needs ffmpeg: install it, or name a .gif")
        self._path = path
        self._scratch = path.with_name(f".{path.stem}.part{path.suffix}")
        self._figure = Figure(figsize=(11, 3.2), layout="constrained")
        FigureCanvasAgg(self._figure)
        self._panels = self._figure.subplots(1, len(PANELS), sharey=True)
        kind = FFMpegWriter if path.suffix == ".mp4" else PillowWriter
        self._movie, self._reach_m = kind(fps=FRAMES_PER_SECOND), 0.0

    def write(self, frame: Published) -> None:
        """Draw one frame."""
        if not self._reach_m:
            self._reach_m = reach_of(frame.clouds)
            self._movie.setup(self._figure, str(self._scratch), dpi=90)
        for axes, (name, area) in zip(self._panels, PANELS.items(), strict=True):
            x, y, z = points_shown(frame.clouds, name).T
            axes.clear()
            axes.scatter(
                y, x, area, z, cmap="turbo", vmin=HEIGHTS_M[0], vmax=HEIGHTS_M[1],
                linewidths=0,
            )  # fmt: skip
            axes.plot(0, 0, "k^")
            axes.set(
                title=TITLES.get(name, name),
                xlabel="y, left (m)",
                xlim=(self._reach_m, -self._reach_m),
                ylim=(-1, self._reach_m),
                aspect="equal",
            )
        self._panels[0].set_ylabel("x, forward (m)")
        self._figure.suptitle(f"frame {frame.number}")
        self._movie.grab_frame()

    def save(self) -> None:
        """Do nothing: a video is complete when it is closed."""

    def close(self) -> None:
        """End the video; without a frame there is none."""
        if self._reach_m:
            self._movie.finish()
            os.replace(self._scratch, self._path)


def points_shown(clouds: dict[str, PointCloud], name: str) -> np.ndarray:
    """Return the drawn points `[point, 3]` of a cloud; none if it is missing."""
    if name not in clouds:
        return np.zeros((0, 3))
    cloud = clouds[name]
    shown = np.asarray(cloud.valid)
    if cloud.snr is not None:
        shown = shown & (np.asarray(cloud.snr) >= STRONG)
    return np.asarray(cloud.xyz)[shown]


def reach_of(clouds: dict[str, PointCloud]) -> float:
    """Return the distance in metres within which most points of a frame lie."""
    every = np.concatenate([points_shown(clouds, name) for name in PANELS])
    distances = np.linalg.norm(every[:, :2], axis=1)
    return float(max(np.percentile([*distances, 2.0], 98), 2.0))
