"""Materials: energy is conserved, slabs match a transfer matrix, metal reflects."""

import numpy as np
import pytest

from jradar.simulation.scenes.materials import (
    MATERIAL_IDS,
    MATERIALS,
    backscatter,
    mirror_share,
    slab_shares,
)

HZ = 78e9
COSINE = np.linspace(0.01, 1, 50)


def of(name):
    return MATERIALS[MATERIAL_IDS[name]]


def transfer_matrix(material, cosine):
    """Reflected and transmitted power of a slab, polarisation by polarisation."""
    permittivity, k0 = material.permittivity(HZ), 2 * np.pi * HZ / 299_792_458.0
    inside = np.sqrt(permittivity - (1 - cosine**2) + 0j)
    shares = []
    for outer, inner in ((cosine, inside), (1 / cosine, permittivity / inside)):
        delta = k0 * material.thickness_m * inside
        b = np.cos(delta) + 1j * np.sin(delta) * outer / inner
        c = outer * np.cos(delta) + 1j * np.sin(delta) * inner
        total = outer * b + c
        shares.append((abs((outer * b - c) / total) ** 2, abs(2 * outer / total) ** 2))
    return np.mean(shares, 0)


@pytest.mark.parametrize("material", MATERIALS, ids=lambda m: m.name)
def test_a_surface_reflects_and_transmits_no_more_than_it_receives(material):
    shares = np.array(slab_shares(material, COSINE, HZ))
    assert (shares > -1e-12).all() and (shares.sum(0) < 1 + 1e-12).all()
    mirrored = mirror_share(material, COSINE, HZ)
    assert ((mirrored >= 0) & (mirrored <= 1)).all()


@pytest.mark.parametrize("name", ["glass", "drywall", "wood", "foliage", "plastic"])
def test_a_slab_matches_its_transfer_matrix(name):
    reflected, transmitted = slab_shares(of(name), COSINE, HZ)
    expected = [transfer_matrix(of(name), cosine) for cosine in COSINE]
    found = np.stack([reflected, transmitted], -1)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_metal_reflects_all_and_smooth_drywall_little_off_its_normal():
    reflected, _ = slab_shares(of("metal"), np.array([1.0]), HZ)
    assert reflected[0] > 0.99
    ahead, aside = backscatter(of("drywall"), np.cos(np.radians([0.0, 30.0])), HZ)
    assert ahead > 40 * aside
    concrete, _ = slab_shares(of("concrete"), np.array([1.0]), HZ)
    index = np.sqrt(of("concrete").permittivity(HZ))
    assert concrete[0] == pytest.approx(abs((1 - index) / (1 + index)) ** 2, rel=1e-6)


def test_a_surface_scatters_no_more_than_it_reflects():
    # Integrated over the half sphere, facets return all that they meet and no more.
    for material in MATERIALS:
        angle = np.linspace(0, np.pi / 2, 4001)[:-1]
        spread = 2 * material.slope**2
        slopes = np.tan(angle)
        density = np.exp(-(slopes**2) / spread) / (np.pi * spread) / np.cos(angle) ** 3
        total = np.trapezoid(density * 2 * np.pi * np.sin(angle), angle)
        assert total == pytest.approx(1, rel=1e-3)
        assert backscatter(material, np.array([1.0]), HZ)[0] <= 1 / spread + 4
