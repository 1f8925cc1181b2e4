"""Materials: what a surface reflects, transmits and absorbs at the radar's frequency.

A surface is a slab of complex permittivity. Reflection and transmission follow from
Fresnel's equations with the multiple reflections inside (ITU-R P.2040-3, eq. 43), as
the mean of both polarisations. Roughness divides the reflected power: a share exp(-g)
is mirrored (Ament 1953), the rest is scattered by tilted facets about the normal (Ulaby
& Long 2014, geometric optics) and by a Lambertian background. Reflected, transmitted
and absorbed power add up to one at every angle.

Permittivities a f^b and conductivities c f^d of building materials are from ITU-R
P.2040-3, table 3, evaluated at the radar's frequency (for brick beyond its 40 GHz).
Grass has the values of dry soil. Skin is close to Gabriel et al. 1996; a leaf is close
to El-Rayes & Ulaby 1987, 0.2 mm thick. Roughness, slopes and LiDAR albedos are
plausible values, not measurements: 0.1 to 0.3 mm for cast and painted surfaces,
centimetres for blasted rock.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from jradar.options.sensor import SPEED_OF_LIGHT

VACUUM_PERMITTIVITY = 8.8541878128e-12


@dataclasses.dataclass(frozen=True)
class MaterialSpec:
    """A surface: permittivity a f^b, conductivity c f^d (f in GHz, S/m), geometry."""

    name: str
    itu: tuple[float, float, float, float]  # a, b, c, d
    thickness_m: float  # infinite: the slab transmits nothing
    roughness_m: float  # standard deviation of heights
    slope: float  # rms, of the scattering facets
    lambert: float  # share of the scattered power in the background
    albedo: float  # diffuse reflectance at the LiDAR's 865 nm
    clear: bool = False  # transparent to the LiDAR
    points_per_m2: float = 6.0  # scatterers

    def permittivity(self, frequency_hz: float) -> complex:
        """Return the relative permittivity; its imaginary part is negative: losses."""
        a, b, c, d = self.itu
        ghz = frequency_hz / 1e9
        losses = c * ghz**d / (2 * np.pi * frequency_hz * VACUUM_PERMITTIVITY)
        return complex(a * ghz**b, -losses)


THICK = float("inf")
CONCRETE = (5.24, 0.0, 0.0462, 0.7822)  # also of rock and asphalt
MATERIALS = (
    MaterialSpec("concrete", CONCRETE, THICK, 0.3e-3, 0.2, 0.15, 0.35),
    MaterialSpec(
        "drywall", (2.73, 0.0, 0.0085, 0.9395), 0.0125, 0.15e-3, 0.15, 0.1, 0.65
    ),
    MaterialSpec("brick", (3.91, 0.0, 0.0238, 0.16), THICK, 0.8e-3, 0.35, 0.3, 0.30),
    MaterialSpec(
        "metal",
        (1.0, 0.0, 1e7, 0.0),
        THICK,
        0.1e-3,
        0.25,
        0.05,
        0.4,
        points_per_m2=25.0,
    ),
    MaterialSpec(
        "glass", (6.31, 0.0, 0.0036, 1.3394), 0.006, 0.01e-3, 0.1, 0.02, 0.0, clear=True
    ),
    MaterialSpec("rock", CONCRETE, THICK, 15e-3, 0.6, 0.5, 0.25),
    MaterialSpec("foliage", (8.0, 0.0, 26.0, 0.0), 0.2e-3, 30e-3, 1.0, 0.9, 0.45),
    MaterialSpec(
        "person", (6.6, 0.0, 38.0, 0.0), THICK, 3e-3, 0.5, 0.4, 0.45, points_per_m2=60.0
    ),
    MaterialSpec("wood", (1.99, 0.0, 0.0047, 1.0718), 0.03, 0.2e-3, 0.25, 0.2, 0.5),
    MaterialSpec("asphalt", CONCRETE, THICK, 1.5e-3, 0.5, 0.4, 0.12),
    MaterialSpec("grass", (3.0, 0.0, 0.05, 0.8), THICK, 20e-3, 1.0, 0.8, 0.4),
    MaterialSpec("floor", (3.66, 0.0, 0.0044, 1.3515), THICK, 0.15e-3, 0.15, 0.1, 0.4),
    MaterialSpec("ceiling", (1.48, 0.0, 0.0011, 1.075), 0.02, 0.5e-3, 0.3, 0.3, 0.8),
    MaterialSpec("plastic", (2.44, 0.0, 2.33e-5, 1.0), 0.004, 0.1e-3, 0.3, 0.1, 0.3),
)
MATERIAL_IDS = {material.name: i for i, material in enumerate(MATERIALS)}


def slab_shares(
    material: MaterialSpec, cosine: Float[np.ndarray, "*batch"], frequency_hz: float
) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
    """Return the reflected and transmitted shares of unpolarised power.

    `cosine` belongs to the angle to the normal. The reflected share includes the
    scattered power. The rest is absorbed.
    """
    permittivity = material.permittivity(frequency_hz)
    cosine = np.clip(np.abs(cosine), 1e-3, 1.0)
    inside = np.sqrt(permittivity - (1 - cosine**2) + 0j)
    faces = (
        (cosine - inside) / (cosine + inside),
        (permittivity * cosine - inside) / (permittivity * cosine + inside),
    )
    if np.isinf(material.thickness_m):
        reflected = np.mean([np.abs(face) ** 2 for face in faces], 0)
        return reflected, np.zeros_like(reflected)
    cycles = material.thickness_m * frequency_hz / SPEED_OF_LIGHT
    turn = np.exp(-2j * np.pi * cycles * inside)
    reflections, transmissions = [], []
    for face in faces:
        echoes = 1 - face**2 * turn**2
        reflections.append(np.abs(face * (1 - turn**2) / echoes) ** 2)
        transmissions.append(np.abs((1 - face**2) * turn / echoes) ** 2)
    return np.mean(reflections, 0), np.mean(transmissions, 0)


def mirror_share(
    material: MaterialSpec, cosine: Float[np.ndarray, "*batch"], frequency_hz: float
) -> Float[np.ndarray, "*batch"]:
    """Return the share of the reflected power that is mirrored (Ament 1953)."""
    wave_number = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT
    return np.exp(-((2 * wave_number * material.roughness_m * np.abs(cosine)) ** 2))


def backscatter(
    material: MaterialSpec, cosine: Float[np.ndarray, "*batch"], frequency_hz: float
) -> Float[np.ndarray, "*batch"]:
    """Return the radar cross-section per area of the scattered power, in m2 per m2.

    A Lambertian surface has 4 cos^2 times its albedo. Facets with slopes of standard
    deviation s have exp(-tan^2 / 2 s^2) / (2 s^2 cos^4) (Ulaby & Long 2014, ch. 10).
    """
    cosine = np.clip(np.abs(cosine), 1e-3, 1.0)
    reflected, _ = slab_shares(material, cosine, frequency_hz)
    scattered = reflected * (1 - mirror_share(material, cosine, frequency_hz))
    spread = 2 * material.slope**2
    tangent_squared = 1 / cosine**2 - 1
    facets = np.exp(-tangent_squared / spread) / (spread * cosine**4)
    lambert = 4 * cosine**2 * material.lambert
    return scattered * (lambert + (1 - material.lambert) * facets)
