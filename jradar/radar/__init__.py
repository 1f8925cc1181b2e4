"""Radar cube to spectra to detections to points (section III-A of the paper).

A `RadarSpec` describes the sensor and a `PointSpec` the processing; both are static
arguments. A `Radar` is a pytree: the spec and the calibration of one unit. Capon,
MUSIC, near fields and several targets in a cell are options of `PointSpec`.

    unit = Radar(RadarSpec.awr1843())
    cube = simulate_cube(key, Scatterers(xyz, velocity, amplitude), unit.spec)
    cloud = radar_points(cube, unit, points=PointSpec(detector="ca"))
    cells = all_cells(cube, unit)          # all directions first, any mask later
"""

from jradar.options.points import PointSpec as PointSpec
from jradar.options.sensor import RadarSpec as RadarSpec
from jradar.radar.angle.deviations import point_deviations as point_deviations
from jradar.radar.angle.direction import directions as directions
from jradar.radar.angle.spectrum import (
    angle_spectrum as angle_spectrum,
    azimuth_map as azimuth_map,
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
from jradar.radar.echoes import (
    noise_statistics as noise_statistics,
    strongest_echoes as strongest_echoes,
)
from jradar.radar.points import (
    Cells as Cells,
    all_cells as all_cells,
    cell_points as cell_points,
    detect as detect,
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
)
