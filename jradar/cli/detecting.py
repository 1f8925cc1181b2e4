"""`jradar points`: frames of a recording to the points that a CFAR detector finds."""

import argparse
import functools
from typing import Any

import numpy as np

from jradar import recordings, viz
from jradar.cli.limits import check_limits, within_limits
from jradar.cli.point_options import given_points
from jradar.cli.reading import (
    echoes,
    open_frames,
    summary,
)
from jradar.cli.writing import check_flat, write_frame
from jradar.errors import UsageError
from jradar.progress import progress
from jradar.radar import (
    PointSpec,
    RadarSpec,
    calibrate,
    noise_statistics,
    point_deviations,
    points_and_report,
    power_map,
)
from jradar.range_image import ImageSpec
from jradar.recordings import Recording, check_samples
from jradar.session.warnings import no_echoes
from jradar.types import PointCloud


def detect_frames(options: argparse.Namespace) -> dict[str, Any]:
    """Detect points in the frames that the options name, and write the results."""
    check_limits(options)
    check_flat(options)
    try:
        spec = PointSpec(**given_points(options))
    except ValueError as error:
        raise UsageError(str(error)) from error
    recording, frames = open_frames(options)
    rows, written, silent = [], [], []
    with progress("detecting", len(frames), unit="frames") as show:
        for done, frame in enumerate(frames, 1):
            row, written, heard = _detect(recording, frame, spec, options)
            rows.append(row)
            silent += [] if heard else [frame]
            if len(frames) > 1:
                show(done)
    notes = (
        *_fitted(options, spec, recording.radar.spec),
        *_dropped(rows, spec),
        *no_echoes(silent),
    )
    if options.frames:
        detected = [_short(row) for row in rows]
        found = {"detected": detected, "written": [options.output]}
    else:
        found = {**rows[0], "written": written}
    return {**summary(recording, notes), **found}


def _detect(recording, frame: int, spec: PointSpec, options):
    """Write one frame; return what was found, the paths, and if there were echoes."""
    cube, radar = recording.cube(frame), recording.radar
    every, report = points_and_report(cube, radar, points=spec.fitted(radar.spec))
    cloud = within_limits(every, options)
    power = power_map(
        calibrate(cube, radar),
        remove_static=spec.remove_static,
        remove_interference=spec.remove_interference,
    )
    view = ImageSpec(64, 64, max_range_m=radar.spec.max_range_m)
    figure = functools.partial(
        viz.capture_figure,
        power,
        radar.spec,
        cloud,
        view,
        lidar=recordings.nearest_scan(recording, frame),
        title=f"{recording.name}, frame {frame}",
    )
    arrays = _deviations(cloud, recording, spec) if options.deviations else {}
    written = write_frame(options, frame, {"radar": cloud}, figure, arrays=arrays)
    row = {
        "frame": frame,
        "points": int(cloud.valid.sum()),
        "detected": int(report.detected),
        "dropped": int(report.dropped),
        "saturated": _saturated(cube),
        "noise": noise_statistics(power, radar.spec)._asdict(),
        "echoes": echoes(cloud, radar),
    }
    return row, written, bool(every.valid.any())


def _saturated(cube) -> int:
    """The numbers that pile up at the end of the converter's scale."""
    numbers = cube.size * (1 + np.iscomplexobj(cube))
    return round(check_samples(cube).share * numbers)


def _deviations(cloud: PointCloud, recording: Recording, spec: PointSpec):
    """Return standard deviations of the valid points, by the names of the arrays."""
    spec = spec.subtracting(recording.radar.leakage)
    found = point_deviations(cloud, recording.radar.spec, points=spec)
    valid = np.asarray(cloud.valid)
    named = found._asdict().items()
    return {f"deviation_{name}": np.asarray(values)[valid] for name, values in named}


def _short(row: dict[str, Any]) -> dict[str, Any]:
    """Return what a table of several frames shows of one."""
    strongest = row["echoes"][0] if row["echoes"] else {}
    return {
        "frame": row["frame"],
        "points": row["points"],
        **{name: row[name] for name in ("detected", "dropped", "saturated")},
        "noise floor (dB)": row["noise"]["floor_db"],
        "strongest echo (m)": strongest.get("range_m"),
        "SNR (dB)": strongest.get("snr_db"),
    }


def _dropped(rows, spec: PointSpec):
    """Yield a note if there were more detections than points."""
    if dropped := sum(row["dropped"] for row in rows):
        yield (
            f"{dropped:,} detections were dropped, the weakest of frames with more "
            f"than {spec.capacity:,}: --capacity N keeps more"
        )


def _fitted(options, spec: PointSpec, radar: RadarSpec):
    """Yield a note if the CFAR window that the user asked for had to shrink."""
    fitted = spec.fitted(radar)
    shrunk = (fitted.guard, fitted.train) != (spec.guard, spec.train)
    if shrunk and {"guard", "train"} & given_points(options).keys():
        yield (
            f"the CFAR window was shrunk to guard {fitted.guard}, train "
            f"{fitted.train}: a larger one does not fit into the map of "
            f"{radar.num_chirps} x {radar.num_range_bins} cells"
        )
