"""Radar cube to spectra to detections to points (section III-A of the paper).

A `RadarSpec` describes the sensor and a `PointSpec` the processing; both are static
arguments. A `Radar` is a pytree: the spec and the calibration of one unit. In the order
of processing:

Sensor       RadarSpec, Radar                  description; with its calibration
Channels     calibrate, subtract_leakage, compensate_tdm
Spectra      range_doppler, power_map, window
Detection    ca_cfar, go_cfar, so_cfar, os_cfar, DETECTORS, noise_floor,
             false_alarm_multiplier, detect
Angles       directions, angle_spectrum, azimuth_map, direction_sines, velocity_folds
Points       PointSpec, radar_points           cube to points of the detected cells
             points_and_count                  and the number of detected cells
             Cells, all_cells, cell_points     all directions first, any mask later
             frame_spectra                     spectra without leakage, as it takes them
             point_deviations                  standard deviation of each coordinate
             cluster                           one cluster for each object, on the host
             strongest_echoes                  summary of a cloud, on the host
             noise_statistics                  and of a power map
Clutter      static_background, subtract_background     of a radar that stands still
Other radars excise_interference               crossing chirps, out of the samples
             draw_interferers, crossing_chirps     and into them
Simulation   Scatterers, simulate_cube         the reverse: scatterers to a cube

Capon, MUSIC, near fields and several targets in a cell are options of `PointSpec`.
"""

from jradar.options.points import PointSpec as PointSpec
from jradar.options.sensor import RadarSpec as RadarSpec
from jradar.radar.angle.deviations import point_deviations as point_deviations
from jradar.radar.angle.direction import directions as directions
from jradar.radar.angle.folds import velocity_folds as velocity_folds
from jradar.radar.angle.spectrum import (
    angle_spectrum as angle_spectrum,
    azimuth_map as azimuth_map,
    direction_sines as direction_sines,
)
from jradar.radar.channels import (
    calibrate as calibrate,
    compensate_tdm as compensate_tdm,
    subtract_leakage as subtract_leakage,
)
from jradar.radar.clean.clutter import (
    static_background as static_background,
    subtract_background as subtract_background,
)
from jradar.radar.clean.interference import (
    crossing_chirps as crossing_chirps,
    draw_interferers as draw_interferers,
    excise_interference as excise_interference,
)
from jradar.radar.detect.cfar import (
    DETECTORS as DETECTORS,
    ca_cfar as ca_cfar,
    go_cfar as go_cfar,
    noise_floor as noise_floor,
    os_cfar as os_cfar,
    so_cfar as so_cfar,
)
from jradar.radar.detect.clusters import cluster as cluster
from jradar.radar.detect.multipliers import (
    false_alarm_multiplier as false_alarm_multiplier,
)
from jradar.radar.echoes import (
    noise_statistics as noise_statistics,
    strongest_echoes as strongest_echoes,
)
from jradar.radar.points import (
    Cells as Cells,
    all_cells as all_cells,
    cell_points as cell_points,
    detect as detect,
    frame_spectra as frame_spectra,
    points_and_count as points_and_count,
    radar_points as radar_points,
)
from jradar.radar.radar import Radar as Radar
from jradar.radar.simulate import (
    Scatterers as Scatterers,
    simulate_cube as simulate_cube,
)
from jradar.radar.spectrum import (
    power_map as power_map,
    range_doppler as range_doppler,
    window as window,
)
