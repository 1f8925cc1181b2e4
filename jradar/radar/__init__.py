"""ADC cube to spectra to detections to points (section III-A of the paper).

RadarSpec                        the radar, a static argument of what follows
CaptureSpec                      how a .cfg has its samples streamed
read_coupling, read_frequency_phase                 ColoRadar's calibration, and how
calibrate_frequency_phase, subtract_coupling        it is applied
calibrate_channels               a .cfg's
range_doppler, power_map         spectra
ca_, go_, so_, os_cfar           detection; noise_floor, false_alarm_multiplier
compensate_tdm, directions       azimuth and elevation of each detection
angle_spectrum, strongest_direction, spectrum_peaks              over all directions
capon_spectrum, music_spectrum, music_directions         azimuths closer than a beam
radar_points                     all of it
all_cells, cell_points           directions of every cell first, detection afterwards
Scatterers, simulate_cube        the way back: scatterers to an ADC cube
"""

from jradar.radar.angle import (
    Peaks as Peaks,
    angle_spectrum as angle_spectrum,
    azimuth_bins as azimuth_bins,
    direction_sines as direction_sines,
    spectrum_peaks as spectrum_peaks,
    strongest_direction as strongest_direction,
)
from jradar.radar.calibration import (
    calibrate_channels as calibrate_channels,
    calibrate_frequency_phase as calibrate_frequency_phase,
    compensate_tdm as compensate_tdm,
    subtract_coupling as subtract_coupling,
)
from jradar.radar.cfar import (
    DETECTORS as DETECTORS,
    ca_cfar as ca_cfar,
    go_cfar as go_cfar,
    largest_window as largest_window,
    noise_floor as noise_floor,
    os_cfar as os_cfar,
    so_cfar as so_cfar,
)
from jradar.radar.direction import directions as directions
from jradar.radar.echoes import (
    Echo as Echo,
    strongest_echoes as strongest_echoes,
)
from jradar.radar.multipliers import (
    false_alarm_multiplier as false_alarm_multiplier,
)
from jradar.radar.points import (
    Cells as Cells,
    PointSpec as PointSpec,
    all_cells as all_cells,
    cell_points as cell_points,
    detect as detect,
    radar_points as radar_points,
)
from jradar.radar.sensor import RadarSpec as RadarSpec
from jradar.radar.simulate import (
    Scatterers as Scatterers,
    simulate_cube as simulate_cube,
)
from jradar.radar.spectrum import (
    doppler_bins as doppler_bins,
    noise_gain as noise_gain,
    power_map as power_map,
    range_doppler as range_doppler,
    window as window,
)
from jradar.radar.subspace import (
    capon_spectrum as capon_spectrum,
    music_directions as music_directions,
    music_spectrum as music_spectrum,
    smoothed_covariance as smoothed_covariance,
)
