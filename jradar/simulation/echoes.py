"""What a radar sees of a scene: every path out and back as a scatterer.

    scattered   points spread over the surfaces, each with its share of the speckle
    mirrored    the radar's own image in a flat face, an edge or a corner
    ghosts      a scatterer by way of a mirror: there and back (at its image), or one
                way only (half-way in range, received from the one, sent to the other)

Each path carries the power of the radar equation: antenna gains, R^-4 (an image: the
radar's own power over 2R), reflection and scattering of the material, and what comes
through the surfaces in between. Paths keep the phase of their length.
"""

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jradar.radar import RadarSpec
from jradar.simulation.link import LinkSpec, antenna_gain
from jradar.simulation.materials import (
    MATERIALS,
    backscatter,
    mirror_share,
    slab_shares,
)
from jradar.simulation.reflectors import Reflectors
from jradar.simulation.scene import NUDGE_M, Placement, Scene, cast

LAYERS = 3  # surfaces that a path passes through at most
LEAST_TRANSMISSION = 1e-3
LANDS_M = 0.02  # how near to its target a ray must end
MIRRORS, GHOSTED = 5, 120  # mirrors and scatterers that make ghosts, the strongest
COSINES = 256  # entries of the tables over the angle to the normal


class Paths(NamedTuple):
    """Paths in the radar's frame; `power` is received, in mW at the antenna."""

    xyz: Float[np.ndarray, "path 3"]  # where the receivers see it
    departure: Float[np.ndarray, "path 3"]  # where the transmitters do
    velocity: Float[np.ndarray, " path"]
    power: Float[np.ndarray, " path"]


class Viewpoint(NamedTuple):
    """The radar at the start of a frame, in the world."""

    xyz: Float[np.ndarray, " 3"]
    turn: Float[np.ndarray, "3 3"]
    velocity: Float[np.ndarray, " 3"]


def radar_paths(
    scene: Scene,
    reflectors: Reflectors,
    places: list[Placement],
    view: Viewpoint,
    radar: RadarSpec,
    link: LinkSpec,
    *,
    capacity: int = 1024,
) -> Paths:
    """The strongest `capacity` paths of a frame; those too weak to matter are left out.

    Strength is weighed with the square of the distance, lest the far ones go first.
    """
    scattered, spots = _scattered(scene, places, view, radar, link, capacity)
    images = _images(scene, reflectors, places, view, radar, link)
    ghosts = _ghosts(scene, reflectors, places, view, radar, link, scattered, spots)
    columns = zip(scattered, images, ghosts, strict=True)
    paths = Paths(*map(np.concatenate, columns))
    distance = np.linalg.norm(paths.xyz, axis=-1)
    audible = paths.power > link.noise_mw(radar) / radar.num_chirps / radar.num_samples
    weight = np.where(audible, paths.power * distance**2, 0.0)
    best = np.argsort(-weight, kind="stable")[:capacity]
    return Paths(*(column[np.sort(best[weight[best] > 0])] for column in paths))


def see(
    scene: Scene,
    places: list[Placement],
    start: Float[np.ndarray, "ray 3"],
    end: Float[np.ndarray, "ray 3"],
    frequency_hz: float,
) -> tuple[Float[np.ndarray, " ray"], Bool[np.ndarray, " ray"]]:
    """Share of the power that gets from start to end, and whether a surface is it."""
    span = end - start
    length = np.linalg.norm(span, axis=-1)
    along = span / np.maximum(length, 1e-9)[:, None]
    through = np.ones(len(start))
    lands = np.zeros(len(start), bool)
    begin = np.zeros(len(start))
    live = np.arange(len(start))
    table = _tables(frequency_hz)[2]
    for _ in range(LAYERS + 1):
        if not live.size:
            break
        origin = start[live] + begin[live, None] * along[live]
        hits = cast(scene, places, origin, along[live])
        at = begin[live] + hits.distance
        lands[live] = np.abs(at - length[live]) < LANDS_M
        blocked = at < length[live] - LANDS_M
        live, at = live[blocked], at[blocked]
        column = (hits.cosine[blocked] * (COSINES - 1)).astype(int)
        through[live] *= table[hits.material[blocked], column]
        begin[live] = at + NUDGE_M
        live = live[through[live] > LEAST_TRANSMISSION]
    through[live] = 0.0  # still behind something
    through[through <= LEAST_TRANSMISSION] = 0.0
    return through, lands


def _scattered(scene, places, view, radar, link, capacity):
    """Points on the surfaces that the radar sees, and where they are in the world."""
    frequency, reach = radar.center_frequency_hz, link.reach_m(radar)
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
        column = (cosine * (COSINES - 1)).astype(int)
        section = _tables(frequency)[0][body.solid.material[face], column]
        section *= body.area_m2[near] * body.reflectivity[near] ** 2
        moving = place.velocity + np.cross(place.spin, xyz[near] - place.xyz)
        columns.append((xyz[near], distance, section, moving))
    xyz, distance, section, moving = (
        np.concatenate(c) for c in zip(*columns, strict=True)
    )
    seen = (xyz - view.xyz) @ view.turn
    gain = antenna_gain(seen, link)
    power = link.radar_equation(radar, gain**2 * section / distance**4)
    power *= link.passband(radar, distance)
    best = np.argsort(-power * distance**2, kind="stable")[: 3 * capacity]
    start = np.broadcast_to(view.xyz, (len(best), 3))
    through, _ = see(scene, places, start, xyz[best], frequency)
    best, through = best[through > 0], through[through > 0]
    towards = (xyz[best] - view.xyz) / distance[best, None]
    velocity = np.einsum("pc,pc->p", towards, moving[best] - view.velocity)
    paths = Paths(seen[best], seen[best], velocity, power[best] * through**2)
    return paths, (xyz[best], moving[best])


def _images(scene, reflectors, places, view, radar, link):
    """The radar's images in flat faces, edges and corners that it sees."""
    frequency, wavelength = radar.center_frequency_hz, radar.wavelength_m
    mirror = _tables(frequency)[1]
    found = []

    def add(xyz, cap, share, velocity, aside=0.0):
        """Points, and how far beside them a ray must get; on them if nowhere."""
        velocity, aside = (np.broadcast_to(v, xyz.shape) for v in (velocity, aside))
        found.append((xyz, cap, share, velocity, aside))

    for facets, place in zip(reflectors.facets, places, strict=True):
        normal = facets.normal @ place.turn.T
        centre = facets.centre @ place.turn.T + place.xyz
        height = ((view.xyz - centre) * normal).sum(-1)
        foot = view.xyz - height[:, None] * normal
        near = ((foot - centre) ** 2).sum(-1) < facets.area_m2**2 + 25 * facets.area_m2
        cap = 4 * np.pi * facets.area_m2**2 / wavelength**2
        share = mirror[facets.material, -1]
        spin = np.cross(place.spin, foot - place.xyz)
        add(foot[near], cap[near], share[near], (place.velocity + spin)[near])

    edges = reflectors.edges
    offset = view.xyz - edges.start
    at = np.einsum("ec,ec->e", offset, edges.along)
    aside = offset - at[:, None] * edges.along
    distance = np.maximum(np.linalg.norm(aside, axis=-1), 1e-6)
    cosine = np.einsum("epc,ec->ep", edges.inward, aside) / distance[:, None]
    on = (at > 0) & (at < edges.length_m) & (cosine > 0).all(1)
    column = (np.clip(cosine, 0, 1) * (COSINES - 1)).astype(int)
    share = mirror[edges.material, column].prod(1)
    cap = 4 * np.pi * (edges.length_m * edges.width_m) ** 2 / wavelength**2
    foot = edges.start + at[:, None] * edges.along
    aside = 2 * LANDS_M * edges.inward.sum(1)
    add(foot[on], cap[on], share[on], np.zeros(3), aside[on])

    corners = reflectors.corners
    offset = view.xyz - corners.xyz
    distance = np.maximum(np.linalg.norm(offset, axis=-1), 1e-6)
    cosine = np.einsum("kpc,kc->kp", corners.inward, offset) / distance[:, None]
    on = (cosine > 0).all(1)
    column = (np.clip(cosine, 0, 1) * (COSINES - 1)).astype(int)
    share = mirror[corners.material, column].prod(1)
    cap = 4 * np.pi * corners.side_m**4 / (3 * wavelength**2)
    aside = 2 * LANDS_M * corners.inward.sum(1)
    add(corners.xyz[on], cap[on], share[on], np.zeros(3), aside[on])

    columns = (np.concatenate(column) for column in zip(*found, strict=True))
    return _image_paths(scene, places, view, radar, link, *columns)


def _image_paths(scene, places, view, radar, link, xyz, cap, share, moving, aside):
    """Paths to image points that are in sight; an image at 2d has pi d^2 of area."""
    seen = (xyz - view.xyz) @ view.turn
    distance = np.linalg.norm(seen, axis=-1)
    keep = (distance < link.reach_m(radar)) & (distance > 0.1) & (share > 1e-4)
    xyz, cap, share, moving, aside, seen, distance = (
        column[keep] for column in (xyz, cap, share, moving, aside, seen, distance)
    )
    start = np.broadcast_to(view.xyz, xyz.shape)
    frequency = radar.center_frequency_hz
    through, landed = see(scene, places, start, xyz + aside, frequency)
    through = np.where(landed | aside.any(-1), through, 0.0)
    section = np.minimum(np.pi * distance**2, cap) * share * through**2
    gain = antenna_gain(seen, link)
    power = link.radar_equation(radar, gain**2 * section / distance**4)
    power *= link.passband(radar, distance)
    towards = (xyz - view.xyz) / distance[:, None]
    velocity = np.einsum("pc,pc->p", towards, moving - view.velocity)
    return Paths(seen, seen, velocity, power)


def _ghosts(scene, reflectors, places, view, radar, link, scattered, spots):
    """Strong scatterers by way of the world's largest mirrors in sight."""
    facets, frequency = reflectors.facets[0], radar.center_frequency_hz
    mirror = _tables(frequency)[1]
    height = ((view.xyz - facets.centre) * facets.normal).sum(-1)
    apart = ((view.xyz - facets.centre) ** 2).sum(-1)
    weight = facets.area_m2 * mirror[facets.material, COSINES // 2] / (1 + apart)
    chosen = np.argsort(-weight, kind="stable")[:MIRRORS]
    strong = np.argsort(-scattered.power, kind="stable")[:GHOSTED]
    empty = Paths(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0))
    if not chosen.size or not strong.size:
        return empty
    m, p = (pair.ravel() for pair in np.meshgrid(chosen, strong, indexing="ij"))
    normal, xyz, moving = facets.normal[m], spots[0][p], spots[1][p]
    beyond = ((xyz - facets.centre[m]) * normal).sum(-1)
    image = xyz - 2 * beyond[:, None] * normal
    same_side = (beyond * height[m] > 0) & (np.abs(beyond) > 0.1)
    offset = image - view.xyz
    distance = np.maximum(np.linalg.norm(offset, axis=-1), 1e-6)
    bounce = view.xyz + offset * (height[m] / (height[m] + beyond + 1e-9))[:, None]
    keep = np.flatnonzero(same_side & (distance < 2 * link.reach_m(radar)))

    start = np.broadcast_to(view.xyz, (len(keep), 3))
    first, lands = see(scene, places, start, bounce[keep], frequency)
    keep, first = keep[lands & (first > 0)], first[lands & (first > 0)]
    side = np.sign(beyond[keep])[:, None] * normal[keep]
    second, _ = see(scene, places, bounce[keep] + NUDGE_M * side, xyz[keep], frequency)
    keep, one_way = keep[second > 0], (first * second)[second > 0]
    if not keep.size:
        return empty

    m, p, distance, offset = m[keep], p[keep], distance[keep], offset[keep]
    cosine = np.abs((offset * normal[keep]).sum(-1)) / distance
    one_way = one_way * mirror[facets.material[m], (cosine * (COSINES - 1)).astype(int)]
    seen, there = offset @ view.turn, scattered.xyz[p]
    near = np.linalg.norm(there, axis=-1)
    reflected = (
        moving[keep] - 2 * (moving[keep] * normal[keep]).sum(-1)[:, None] * normal[keep]
    )
    rate = (offset / distance[:, None] * (reflected - view.velocity)).sum(-1)
    # Per way, relative to the direct one: gain, spreading, reflection.
    way = antenna_gain(seen, link) / np.maximum(antenna_gain(there, link), 1e-9)
    way = way * (near / distance) ** 2 * one_way
    direct = scattered.power[p] / np.maximum(link.passband(radar, near), 1e-9)
    halfway = (near + distance) / 2
    mixed = direct * way * link.passband(radar, halfway)
    mixed_rate = (scattered.velocity[p] + rate) / 2
    return Paths(
        np.concatenate([seen, seen, there]),
        np.concatenate([seen, there, seen]),
        np.concatenate([rate, mixed_rate, mixed_rate]),
        np.concatenate(
            [direct * way**2 * link.passband(radar, distance), mixed, mixed]
        ),
    )


@functools.lru_cache
def _tables(frequency_hz: float) -> np.ndarray:
    """Backscatter, mirror reflection, transmission by [material, cosine]."""
    cosine = np.linspace(0, 1, COSINES)
    rows = []
    for material in MATERIALS:
        reflected, transmitted, _ = slab_shares(material, cosine, frequency_hz)
        mirrored = reflected * mirror_share(material, cosine, frequency_hz)
        rows.append(
            (backscatter(material, cosine, frequency_hz), mirrored, transmitted)
        )
    return np.array(rows).swapaxes(0, 1)
