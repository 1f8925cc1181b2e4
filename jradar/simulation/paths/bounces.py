"""Paths via the floor, and echoes between parallel walls.

A target at height h above a flat floor has an image at depth h. The floor may
reflect the wave on neither, one or both of its legs, out and back:

    neither leg               1
    one leg                   2 rho e^(jkd)
    both legs                 rho^2 e^(2jkd)

With a difference of path length d and a wave number k the sum is (1 + rho e^(jkd))^2,
the two-ray law. rho is negative at flat angles for both polarisations (Skolnik 2008,
Radar Handbook, ch. 26); its power is Fresnel's, less what roughness scatters (Ament
1953).

A radar between two parallel walls at distances a and b also receives the echoes that
pass between them: at a + b, sent towards one and received from the other, at 2a + b,
and at a + 2b.
"""

import numpy as np
from jaxtyping import Bool, Float

from jradar.simulation.paths.line_of_sight import (
    NO_PATHS,
    TOUCH_M,
    Paths,
    Sight,
    column_of,
    line_of_sight,
)
from jradar.simulation.paths.link import LINK
from jradar.simulation.paths.reflectors import Facets
from jradar.simulation.scenes.materials import MATERIALS
from jradar.simulation.scenes.scene import NUDGE_M, cast

FLOOR_M = 0.0  # height of the scenes' floors
LEAST_HEIGHT_M = 0.05  # of a target above the floor
PARALLEL = 0.999  # cosine from which two walls count as parallel
WALLS = 8  # nearest and largest, between which echoes pass
ROUGHNESS_M = np.array([material.roughness_m for material in MATERIALS])


def is_floor(facets: Facets) -> Bool[np.ndarray, " facet"]:
    """Return which facets belong to the floor."""
    level = np.abs(facets.normal[:, 2]) > PARALLEL
    return level & (np.abs(facets.centre[:, 2] - FLOOR_M) < TOUCH_M)


def floor_share(
    cosine: Float[np.ndarray, "*batch"],
    reflected: Float[np.ndarray, "*batch"],
    *,
    roughness_m: Float[np.ndarray, "*batch"] | float,
    wavelength_m: float,
) -> Float[np.ndarray, "*batch"]:
    """Return the mirrored share of the power: Fresnel's, times Ament's exp(-g)."""
    return reflected * np.exp(-((4 * np.pi * roughness_m * cosine / wavelength_m) ** 2))


def floor_paths(
    sight: Sight,
    scattered: Paths,
    spots: tuple[Float[np.ndarray, "path 3"], Float[np.ndarray, "path 3"]],
    *,
    roughness_m: float,
) -> Paths:
    """Return the paths to scatterers via the floor, one way and both ways.

    `spots` are the places and velocities of the `scattered` paths in the world. The
    floor is at least as rough as its material.
    """
    (xyz, moving), view, radar = spots, sight.view, sight.radar
    high, above = view.xyz[2] - FLOOR_M, xyz[:, 2] - FLOOR_M
    image = xyz * [1, 1, -1] + [0, 0, 2 * FLOOR_M]
    offset = image - view.xyz
    distance = np.linalg.norm(offset, axis=-1)
    keep = np.flatnonzero((above > LEAST_HEIGHT_M) & (distance < LINK.reach_m(radar)))
    if high < LEAST_HEIGHT_M or not keep.size:
        return NO_PATHS
    share = high / (high + above[keep])
    bounce = view.xyz + offset[keep] * share[:, None]
    along = offset[keep] / distance[keep, None]
    start = np.broadcast_to(view.xyz, bounce.shape)
    hits = cast(sight.scene, sight.places, start, along)
    lands = np.abs(hits.distance - share * distance[keep]) < TOUCH_M
    keep, bounce, along = keep[lands], bounce[lands], along[lands]
    material = hits.material[lands]
    through, _ = line_of_sight(sight, bounce + [0, 0, NUDGE_M], xyz[keep])
    keep, along, material, through = (
        column[through > 0] for column in (keep, along, material, through)
    )
    if not keep.size:
        return NO_PATHS
    cosine = np.abs(along[:, 2])
    mirrored = floor_share(
        cosine,
        sight.tables.reflected[material, column_of(cosine)],
        roughness_m=np.maximum(ROUGHNESS_M[material], roughness_m),
        wavelength_m=radar.wavelength_m,
    )
    rate = (along * (moving[keep] * [1, 1, -1] - view.velocity)).sum(-1)
    return mirrored_paths(
        sight,
        scattered.chosen(keep),
        offset[keep],
        (mirrored, through),
        rate,
        # One reflection shifts the phase by pi: a quarter of a wavelength in range.
        longer_m=radar.wavelength_m / 4,
    )


def mirrored_paths(
    sight: Sight,
    direct: Paths,
    offset: Float[np.ndarray, "path 3"],
    shares: tuple[Float[np.ndarray, " path"], ...],
    rate: Float[np.ndarray, " path"],
    *,
    longer_m: float = 0.0,
) -> Paths:
    """Return the paths to scatterers via a mirror, both ways and one way.

    Their images lie at `offset` from the radar and recede at `rate`; the mirror and
    all before it pass `shares` of the power. One-way paths become `longer_m` longer.
    """
    radar, seen, there = sight.radar, offset @ sight.view.turn, direct.xyz
    near, far = np.linalg.norm(there, axis=-1), np.linalg.norm(offset, axis=-1)
    # Gain, spreading and reflection of one way, relative to the direct way.
    way = LINK.antenna_gain(seen) / np.maximum(LINK.antenna_gain(there), 1e-9)
    way = way * (near / far) ** 2
    for share in shares:
        way = way * share
    power = direct.power / np.maximum(LINK.passband(radar, near), 1e-9)
    once = power * way * LINK.passband(radar, (near + far) / 2)
    twice = power * way**2 * LINK.passband(radar, far)
    mixed = (direct.velocity + rate) / 2
    turned = [_longer(side, longer_m) for side in (seen, there)]
    return Paths(
        np.concatenate([seen, turned[0], turned[1]]),
        np.concatenate([seen, turned[1], turned[0]]),
        np.concatenate([rate, mixed, mixed]),
        np.concatenate([twice, once, once]),
    )


def _longer(xyz, metres):
    distance = np.linalg.norm(xyz, axis=-1, keepdims=True)
    return xyz * (1 + metres / np.maximum(distance, 1e-6))


def echoes_between_walls(sight: Sight, facets: Facets) -> Paths:
    """Return the radar's own echoes that pass between two parallel walls.

    The walls stand on both sides of the radar, and each is in sight at its foot.
    """
    view, radar, mirror = sight.view, sight.radar, sight.tables.mirrored[:, -1]
    height = ((view.xyz - facets.centre) * facets.normal).sum(-1)
    foot = view.xyz - height[:, None] * facets.normal
    near = ((foot - facets.centre) ** 2).sum(-1) < facets.area_m2
    near &= (np.abs(height) > 0.1) & (np.abs(height) < LINK.reach_m(radar))
    weight = np.where(near & ~is_floor(facets), mirror[facets.material], 0.0)
    best = np.argsort(-weight / np.maximum(np.abs(height), 0.1), kind="stable")[:WALLS]
    best = best[weight[best] > 0]
    if best.size < 2:
        return NO_PATHS
    through, lands = line_of_sight(sight, view.xyz, foot[best])
    best, through = (column[lands & (through > 0)] for column in (best, through))
    offset = foot[best] - view.xyz
    apart = np.linalg.norm(offset, axis=-1)
    towards = offset / apart[:, None]
    first, second = np.nonzero(towards @ towards.T < -PARALLEL)
    if not first.size:
        return NO_PATHS
    a, b = apart[first], apart[second]
    there, back = towards[first], towards[second]
    kept = mirror[facets.material[best]] * through**2
    speed = -(towards @ view.velocity)
    # Sent towards the first: received from the second, or again from the first.
    length = np.concatenate([a + b, 2 * a + b])
    sent = np.concatenate([there, there])
    received = np.concatenate([back, there])
    lost = np.concatenate([kept[first] * kept[second], kept[first] ** 2 * kept[second]])
    rate = np.concatenate([speed[first] + speed[second]] * 2) * 1.0
    rate[len(a) :] += speed[first]
    seen, departure = (
        (side * length[:, None]) @ view.turn for side in (received, sent)
    )
    gain = LINK.antenna_gain(seen) * LINK.antenna_gain(departure)
    # An image at range R returns the radar's own power over the path 2R: an area of
    # pi R^2 (see `propagation`).
    area = np.pi * length**2 * lost * gain
    ahead = np.broadcast_to([1.0, 0.0, 0.0], seen.shape)
    power = LINK.received_mw(radar, ahead, length, area)
    return Paths(seen, departure, rate, power)
