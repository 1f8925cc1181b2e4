"""Paths of a radar's signal through a scene, each as a scatterer.

    scattered   points spread over the surfaces, each with its own speckle
    mirrored    the radar's image in a flat face, an edge or a corner
    ghosts      a scatterer seen via a mirror: both ways (at its image), or one way
                (half-way in range; sent towards one, received from the other)
    bounces     ghosts in the floor, and echoes between walls, for units that have them
                (see `bounces`)

The power of a path follows the radar equation: antenna gains, R^-4 (for an image: the
radar's own power over 2R), reflection and scattering of the material, and transmission
through the surfaces in between. Paths keep the phase of their length.
"""

import numpy as np

from jradar.radar import RadarSpec
from jradar.simulation.paths.bounces import (
    echoes_between_walls,
    floor_paths,
    is_floor,
    mirrored_paths,
)
from jradar.simulation.paths.clutter import foliage_velocity
from jradar.simulation.paths.line_of_sight import (
    COSINES,
    NO_PATHS,
    TOUCH_M,
    Paths,
    Sight,
    column_of,
    joined,
    line_of_sight,
)
from jradar.simulation.paths.link import LINK
from jradar.simulation.paths.reflectors import Reflectors
from jradar.simulation.rig import viewpoint
from jradar.simulation.scenes.materials import MATERIAL_IDS
from jradar.simulation.scenes.scene import NUDGE_M, Scene, placements
from jradar.simulation.units import UnitSpec

FOLIAGE = MATERIAL_IDS["foliage"]
CAPACITY = 1024  # paths of a frame
MIRRORS, GHOSTED = 5, 120  # strongest mirrors and scatterers, which make ghosts
DEFAULT = UnitSpec()


def radar_paths(
    scene: Scene,
    reflectors: Reflectors,
    sensor: str,
    time_s: float,
    radar: RadarSpec,
    *,
    unit: UnitSpec = DEFAULT,
) -> Paths:
    """Return the paths that the rig's radar `sensor` receives at a time.

    The `unit` determines the reflections between surfaces, and the wind.
    Paths below the noise are left out. Of the others the strongest `CAPACITY` stay,
    where strength is power times distance squared: far echoes are kept, too.
    """
    view = viewpoint(scene.platform, sensor, time_s)
    sight = Sight(scene, placements(scene, time_s), view, radar)
    facets = reflectors.facets[0]
    wind = foliage_velocity(unit.wind_mph, radar, time_s)
    scattered, spots = _scattered(sight, wind)
    images = _images(sight, reflectors)
    strong = np.argsort(-scattered.power, kind="stable")[:GHOSTED]
    strongest = scattered.chosen(strong), (spots[0][strong], spots[1][strong])
    mirrors = _mirrors(sight, facets, floor=not unit.floor_bounces)
    ghosts = _ghosts(sight, facets, mirrors, *strongest)
    if unit.ghost_db:
        ghosts = ghosts._replace(power=ghosts.power * 10 ** (unit.ghost_db / 10))
    parts = [scattered, images, ghosts]
    if unit.floor_bounces:
        roughness_m = unit.floor_roughness_m
        parts.append(floor_paths(sight, *strongest, roughness_m=roughness_m))
    if unit.wall_echoes:
        parts.append(echoes_between_walls(sight, facets))
    paths = joined(parts)
    distance = np.linalg.norm(paths.xyz, axis=-1)
    audible = paths.power > LINK.noise_mw(radar) / radar.num_chirps / radar.num_samples
    weight = np.where(audible, paths.power * distance**2, 0.0)
    best = np.argsort(-weight, kind="stable")[:CAPACITY]
    return paths.chosen(np.sort(best[weight[best] > 0]))


def _scattered(sight, wind):
    """Return paths to points on surfaces, and their places and velocities.

    `wind` returns the speeds of a number of leaves, or is None.
    """
    scene, places, view, radar = sight
    reach, backscatter = LINK.reach_m(radar), sight.tables.backscatter
    columns = []
    for body, place in zip(scene.bodies, places, strict=True):
        if np.linalg.norm(place.xyz - view.xyz) > reach + body.radius_m:
            continue
        xyz = body.points @ place.turn.T + place.xyz
        offset = xyz - view.xyz
        squared = np.einsum("pc,pc->p", offset, offset)
        near = np.flatnonzero((squared < reach**2) & (squared > 0.01))
        offset, distance = offset[near], np.sqrt(squared[near])
        face = body.point_face[near]
        normal = body.normals[face] @ place.turn.T
        cosine = np.abs(np.einsum("pc,pc->p", offset, normal)) / distance
        column = column_of(cosine)
        section = backscatter[body.solid.material[face], column]
        section *= body.area_m2[near] * body.reflectivity[near] ** 2
        moving = place.velocity + np.cross(place.spin, xyz[near] - place.xyz)
        leaf = body.solid.material[face] == FOLIAGE
        columns.append((xyz[near], distance, section, moving, leaf))
    columns = map(np.concatenate, zip(*columns, strict=True))
    xyz, distance, section, moving, leaf = columns
    seen = (xyz - view.xyz) @ view.turn
    power = LINK.received_mw(radar, seen, distance, section)
    best = np.argsort(-power * distance**2, kind="stable")[: 3 * CAPACITY]
    through, _ = line_of_sight(sight, view.xyz, xyz[best])
    best, through = best[through > 0], through[through > 0]
    towards = (xyz[best] - view.xyz) / distance[best, None]
    moving = moving[best]
    if wind is not None:
        moving = moving + (leaf[best] * wind(len(best)))[:, None] * towards
    velocity = np.einsum("pc,pc->p", towards, moving - view.velocity)
    paths = Paths(seen[best], seen[best], velocity, power[best] * through**2)
    return paths, (xyz[best], moving)


def _images(sight, reflectors):
    """Return paths to the radar's images in flat faces, edges and corners."""
    view, wavelength = sight.view, sight.radar.wavelength_m
    mirror, found = sight.tables.mirrored, []

    def add(xyz, cap, share, *, velocity=0.0, aside=0.0):
        """Add images; `aside` is added to the point that a ray must reach."""
        velocity, aside = (np.broadcast_to(v, xyz.shape) for v in (velocity, aside))
        found.append((xyz, cap, share, velocity, aside))

    for facets, place in zip(reflectors.facets, sight.places, strict=True):
        normal = facets.normal @ place.turn.T
        centre = facets.centre @ place.turn.T + place.xyz
        height = ((view.xyz - centre) * normal).sum(-1)
        foot = view.xyz - height[:, None] * normal
        near = ((foot - centre) ** 2).sum(-1) < facets.area_m2**2 + 25 * facets.area_m2
        cap = 4 * np.pi * facets.area_m2**2 / wavelength**2
        share = mirror[facets.material, -1]
        spin = np.cross(place.spin, foot - place.xyz)
        moving = (place.velocity + spin)[near]
        add(foot[near], cap[near], share[near], velocity=moving)

    edges = reflectors.edges
    offset = view.xyz - edges.start
    at = np.einsum("ec,ec->e", offset, edges.along)
    aside = offset - at[:, None] * edges.along
    faced, share = _towards(aside, edges, mirror)
    on = (at > 0) & (at < edges.length_m) & faced
    cap = 4 * np.pi * (edges.length_m * edges.width_m) ** 2 / wavelength**2
    foot = edges.start + at[:, None] * edges.along
    aside = 2 * TOUCH_M * edges.inward.sum(1)
    add(foot[on], cap[on], share[on], aside=aside[on])

    corners = reflectors.corners
    on, share = _towards(view.xyz - corners.xyz, corners, mirror)
    cap = 4 * np.pi * corners.side_m**4 / (3 * wavelength**2)
    aside = 2 * TOUCH_M * corners.inward.sum(1)
    add(corners.xyz[on], cap[on], share[on], aside=aside[on])

    columns = map(np.concatenate, zip(*found, strict=True))
    return _image_paths(sight, *columns)


def _towards(offset, joints, mirror):
    """Return which edges or corners face the radar, and the share they mirror."""
    distance = np.maximum(np.linalg.norm(offset, axis=-1), 1e-6)
    cosine = np.einsum("kpc,kc->kp", joints.inward, offset) / distance[:, None]
    share = mirror[joints.material, column_of(np.clip(cosine, 0, 1))].prod(1)
    return (cosine > 0).all(1), share


def _image_paths(sight, xyz, cap, share, moving, aside):
    """Return paths to the images in sight; an image at 2d has an area of pi d^2."""
    view, radar = sight.view, sight.radar
    seen = (xyz - view.xyz) @ view.turn
    distance = np.linalg.norm(seen, axis=-1)
    keep = (distance < LINK.reach_m(radar)) & (distance > 0.1) & (share > 1e-4)
    xyz, cap, share, moving, aside, seen, distance = (
        column[keep] for column in (xyz, cap, share, moving, aside, seen, distance)
    )
    through, landed = line_of_sight(sight, view.xyz, xyz + aside)
    through = np.where(landed | aside.any(-1), through, 0.0)
    section = np.minimum(np.pi * distance**2, cap) * share * through**2
    power = LINK.received_mw(radar, seen, distance, section)
    towards = (xyz - view.xyz) / distance[:, None]
    velocity = np.einsum("pc,pc->p", towards, moving - view.velocity)
    return Paths(seen, seen, velocity, power)


def _mirrors(sight, facets, *, floor):
    """Return the indices of the largest mirrors nearby; `floor` is one of them."""
    apart = ((sight.view.xyz - facets.centre) ** 2).sum(-1)
    mirror = sight.tables.mirrored
    weight = facets.area_m2 * mirror[facets.material, COSINES // 2] / (1 + apart)
    if not floor:
        weight = np.where(is_floor(facets), 0.0, weight)
    best = np.argsort(-weight, kind="stable")[:MIRRORS]
    return best if floor else best[weight[best] > 0]


def _ghosts(sight, facets, chosen, scattered, spots):
    """Return paths to strong scatterers via the `chosen` mirrors."""
    view, radar, mirror = sight.view, sight.radar, sight.tables.mirrored
    height = ((view.xyz - facets.centre) * facets.normal).sum(-1)
    strong = np.arange(len(scattered.power))
    if not chosen.size or not strong.size:
        return NO_PATHS
    m, p = (pair.ravel() for pair in np.meshgrid(chosen, strong, indexing="ij"))
    normal, xyz, moving = facets.normal[m], spots[0][p], spots[1][p]
    beyond = ((xyz - facets.centre[m]) * normal).sum(-1)
    image = xyz - 2 * beyond[:, None] * normal
    same_side = (beyond * height[m] > 0) & (np.abs(beyond) > 0.1)
    offset = image - view.xyz
    distance = np.maximum(np.linalg.norm(offset, axis=-1), 1e-6)
    bounce = view.xyz + offset * (height[m] / (height[m] + beyond + 1e-9))[:, None]
    keep = np.flatnonzero(same_side & (distance < 2 * LINK.reach_m(radar)))

    first, lands = line_of_sight(sight, view.xyz, bounce[keep])
    keep, first = keep[lands & (first > 0)], first[lands & (first > 0)]
    side = np.sign(beyond[keep])[:, None] * normal[keep]
    second, _ = line_of_sight(sight, bounce[keep] + NUDGE_M * side, xyz[keep])
    keep, one_way = keep[second > 0], (first * second)[second > 0]
    if not keep.size:
        return NO_PATHS

    m, p, distance, offset, moving, normal = (
        column[keep] for column in (m, p, distance, offset, moving, normal)
    )
    cosine = np.abs((offset * normal).sum(-1)) / distance
    one_way = one_way * mirror[facets.material[m], column_of(cosine)]
    reflected = moving - 2 * (moving * normal).sum(-1)[:, None] * normal
    rate = (offset / distance[:, None] * (reflected - view.velocity)).sum(-1)
    return mirrored_paths(sight, scattered.chosen(p), offset, (one_way,), rate)
