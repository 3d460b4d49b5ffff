# SPDX-License-Identifier: GPL-3.0-or-later
"""The constants of the methods as upper bounds.

Every point of a facet, of a refined net and of the surface is a linear function of the net, so each constant is at
least the largest value of some functionals c·V over all nets with |DV| ≤ 1, D being the second (or first) differences:
a linear program for each. Points in space come down to numbers by projection on the direction of the largest value.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.norm_bounds import (
    PATCH_METHODS,
    Method,
    Vertices,
    first_order_extraordinary,
    first_order_rate,
    first_order_regular,
    limit_displacement,
    published_divisor,
    published_rate,
    second_order_extraordinary,
    second_order_regular,
    support_bounds,
)
from ccdepth_addon.core.depth.face_depths import face_depths
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.patches import (
    PatchKind,
    classify_patches,
    extraordinary_nets,
    faces_on_grids,
    regular_nets,
)
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes, nets
from tests.linear_programs import PROGRAM_TOLERANCE, largest_of

VALENCES = (3, 5, 6, 7, 8, 9, 10, 11, 12, 16, 32)
# Distances are sampled at steps of 2⁻³, of unrefined facets at 2⁻⁴.
SAMPLES = 3

every_valence = pytest.mark.parametrize("valence", VALENCES)

# Rounding of sums of some products of values around 1, where faces are flat.
ROUNDING = 1e-13


# Stencils: rows of weights over the points of a net


@cache
def level_one(valence: int) -> tuple[FloatArray, FloatArray]:
    """The nets of face 0's children as stencils: the extraordinary (2n + 8, D) and the regular ones (4, 4, 3, D)."""
    fine = nets.refined(nets.net_mesh(np.eye(2 * valence + 8)), 1)
    children = np.arange(4)
    patches = classify_patches(fine)
    assert patches.kinds[children].tolist() == [PatchKind.EXTRAORDINARY, *[PatchKind.REGULAR] * 3]
    corner = patches.extraordinary_corners[:1]
    return extraordinary_nets(fine, corner, valence)[:, 0], regular_nets(fine, children[1:])


@cache
def distance_stencils(valence: int, level: int, vertices: str) -> FloatArray:
    """(9, 9, D) or at level 0 (17, 17, D): Lᵏ - S on face 0.

    Only where u ≥ v, and zero elsewhere: what lies beyond the diagonal is the mirror image.
    """
    mesh, face = nets.net_mesh(np.eye(2 * valence + 8)), np.array([0])
    samples = SAMPLES + (level == 0)
    facets = nets.facet_grids(mesh, face, level, vertices, samples)[0]
    offsets = facets - nets.limit_grids(mesh, face, samples)[0]
    return offsets * np.tri(2**samples + 1)[:, :, None]


def hand_refined(valence: int) -> dict[str, FloatArray]:
    """One step of a net by Catmull and Clark's masks, written out: some points near the extraordinary vertex.

    Named by where they lie on the grid of V₁ (0, 0), V₆ (1, 0), V₄ (0, 1).
    """
    n = valence
    v = {number + 1: row for number, row in enumerate(np.eye(2 * n + 8))}

    def face(*numbers: int) -> FloatArray:
        return sum(v[number] for number in numbers) / 4

    spokes = sum(v[2 * i] for i in range(1, n + 1))
    diagonals = sum(v[2 * i + 1] for i in range(1, n + 1))
    v7, v8 = nets.ring(n, 7), nets.ring(n, 8)
    middle = face(1, 6, 5, 4)
    left, below = face(1, 4, 3, 2), face(1, 6, v7, v8)
    above, right = face(4, 5, 2 * n + 6, 2 * n + 7), face(6, 5, 2 * n + 3, 2 * n + 4)
    return {
        "(0, 0)": (1 - 7 / (4 * n)) * v[1] + 3 / (2 * n * n) * spokes + 1 / (4 * n * n) * diagonals,
        "(½, ½)": middle,
        "(½, 0)": (v[1] + v[6] + middle + below) / 4,
        "(0, ½)": (v[1] + v[4] + middle + left) / 4,
        "(1, ½)": (v[6] + v[5] + middle + right) / 4,
        "(½, 1)": (v[4] + v[5] + middle + above) / 4,
        "(-½, ½)": left,
        "(½, -½)": below,
        "(1, 1)": (36 * v[5] + 6 * (v[4] + v[6] + v[2 * n + 3] + v[2 * n + 6])) / 64
        + (v[1] + v[2 * n + 2] + v[2 * n + 4] + v[2 * n + 7]) / 64,
        "(1, 0)": (36 * v[6] + 6 * (v[1] + v[5] + v[v7] + v[2 * n + 4])) / 64
        + (v[4] + v[v8] + v[2 * n + 3] + v[2 * n + 5]) / 64,
    }


@every_valence
def test_stencils_agree_with_masks_written_by_hand(valence: int) -> None:
    extraordinary, regular = level_one(valence)
    number = {"(0, 0)": 1, "(½, ½)": 5, "(½, 0)": 6, "(0, ½)": 4, "(-½, ½)": 3, "(½, -½)": nets.ring(valence, 7)}
    n = valence
    number |= {"(1, 1)": 2 * n + 2, "(1, ½)": 2 * n + 3, "(1, 0)": 2 * n + 4, "(½, 1)": 2 * n + 6}
    by_hand = hand_refined(valence)
    assert set(number) == set(by_hand)
    for place, at in number.items():
        np.testing.assert_allclose(extraordinary[at - 1], by_hand[place], rtol=0, atol=1e-15)
    # The child opposite V₁ begins at V₅ and has the middle of the face diagonally across.
    np.testing.assert_allclose(regular[1, 1, 1], by_hand["(1, 1)"], rtol=0, atol=1e-15)
    np.testing.assert_allclose(regular[2, 2, 1], by_hand["(½, ½)"], rtol=0, atol=1e-15)


@every_valence
def test_limit_stencils_agree_with_plain_subdivision(valence: int) -> None:
    """S at the corners and in the middle of the face and its edges, applied to a random net."""
    points = np.random.default_rng(valence).normal(size=(2 * valence + 8, 3))
    mesh, face, levels = nets.net_mesh(points), np.array([0]), 5
    fine = nets.refined(mesh, levels)
    deep = fine.positions[nets.vertex_grids(fine, face, levels)][0]
    surface = (nets.limit_grids(nets.net_mesh(np.eye(len(points))), face, 1)[0]) @ points
    # After k steps no more than M/z · rᵏ of the way remains.
    remaining = second_order_extraordinary(points[:, None], Vertices.CONTROL).at(levels)[0]
    offsets = np.linalg.norm(deep[:: 2 ** (levels - 1), :: 2 ** (levels - 1)] - surface, axis=-1)
    assert offsets.max() <= remaining


# Lemma 4 and Lemma 7


@every_valence
def test_second_order_norm_shrinks_as_published(valence: int) -> None:
    differences = nets.difference_matrix(valence)
    extraordinary, regular = level_one(valence)
    growth = largest_of(differences @ extraordinary, differences)
    assert growth <= published_rate(valence) + PROGRAM_TOLERANCE
    # The children that are regular have to keep below the bound as well: M¹/3 ≤ r · M/z.
    found = [2 * regular[a] - regular[b] - regular[c] for a, b, c in nets.listed_regular_differences()]
    beside = largest_of(np.stack(found), differences)
    assert beside / 3 <= published_rate(valence) / published_divisor(valence) + PROGRAM_TOLERANCE
    assert beside / 4 <= published_rate(valence) * limit_factor(valence) + PROGRAM_TOLERANCE


@pytest.mark.parametrize(
    ("valence", "sharp"), [(3, 2 / 3), (5, 0.72), (6, 0.75), (7, 0.75 + 10 / 196), (8, 0.75), (10, 0.83)]
)
def test_sharp_rates(valence: int, sharp: float) -> None:
    """The least rates that hold: the published ones at 3, 5 and 7, which cannot be improved."""
    differences = nets.difference_matrix(valence)
    growth = largest_of(differences @ level_one(valence)[0], differences)
    assert growth == pytest.approx(sharp, abs=PROGRAM_TOLERANCE)
    assert (growth == pytest.approx(published_rate(valence), abs=PROGRAM_TOLERANCE)) == (valence in (3, 5, 7))


@every_valence
def test_sharp_distances(valence: int) -> None:
    """The least factors of M that hold for a facet are 3/8 at valence 3, and 1/3 elsewhere as on regular patches."""
    found = largest_of(distance_stencils(valence, 0, "CONTROL"), nets.difference_matrix(valence))
    assert found == pytest.approx(3 / 8 if valence == 3 else 1 / 3, abs=PROGRAM_TOLERANCE)


def test_limit_facets_of_valence_3_reach_their_distance() -> None:
    """7/27 is the least factor there, reached between the samples."""
    found = largest_of(distance_stencils(3, 0, "LIMIT"), nets.difference_matrix(3))
    assert found == pytest.approx(7 / 27, rel=0.005)
    assert limit_factor(3) == pytest.approx(7 / 27)


def control_factor(valence: int) -> float:
    """‖L - S‖/M as the method has it."""
    return 1 / published_divisor(valence)


def limit_factor(valence: int) -> float:
    """‖L̂ - S‖/M as the method has it, read off a net with norm 1."""
    net = np.zeros((2 * valence + 8, 1, 3))
    net[2 * valence + 1, 0, 0] = 1
    return float(second_order_extraordinary(net, Vertices.LIMIT).value[0])


@every_valence
@pytest.mark.parametrize("level", [0, 1, 2])
def test_control_facets_lie_within_the_published_distance(valence: int, level: int) -> None:
    found = largest_of(distance_stencils(valence, level, "CONTROL"), nets.difference_matrix(valence))
    assert found <= control_factor(valence) * published_rate(valence) ** level + PROGRAM_TOLERANCE


@every_valence
@pytest.mark.parametrize("level", [0, 1, 2])
def test_limit_facets_lie_within_their_distance(valence: int, level: int) -> None:
    found = largest_of(distance_stencils(valence, level, "LIMIT"), nets.difference_matrix(valence))
    assert found <= limit_factor(valence) * published_rate(valence) ** level + PROGRAM_TOLERANCE


@every_valence
def test_corners_go_no_farther_than_the_limit_displacement(valence: int) -> None:
    mesh = nets.net_mesh(np.eye(2 * valence + 8))
    corners = mesh.corner_vertices[:4]
    ways = limit_positions(mesh)[corners] - mesh.positions[corners]
    found = largest_of(ways, nets.difference_matrix(valence))
    # At valence 3 it is the extraordinary corner, elsewhere a regular one, that goes farthest.
    assert found == pytest.approx(limit_displacement(valence), abs=PROGRAM_TOLERANCE)


def test_constants_as_printed() -> None:
    assert [1 / published_rate(n) for n in (3, 5)] == pytest.approx([3 / 2, 25 / 18])
    assert [published_divisor(n) for n in (3, 5, 6, 7, 8)] == pytest.approx([1, *[25 / 18] * 4])
    for n in range(6, 65):
        assert 1 / published_rate(n) == pytest.approx(4 * n * n / (3 * n * n + 8 * n - 46))
        assert published_rate(n) == pytest.approx(3 / 4 + (8 * n - 46) / (4 * n * n))
    for n in range(9, 65):
        assert published_divisor(n) == pytest.approx(2 * (n * n - 8 * n + 46) / (n * n))


# The erratum


def printed_lemma_7(valence: int) -> float:
    """1/z for n > 8 as Lemma 7 prints it, too small by a factor of 2."""
    return valence**2 / (4 * (valence**2 - 8 * valence + 46))


def test_lemma_7_as_printed_is_false_at_valence_32() -> None:
    """A net whose facet is farther from the surface, at its regular corner V₅, than the printed bound allows."""
    valence = 32
    differences = nets.difference_matrix(valence)
    corner = distance_stencils(valence, 0, "CONTROL")[-1, -1]
    both_signs = np.vstack([differences, -differences])
    solution = linprog(-corner, A_ub=both_signs, b_ub=np.ones(len(both_signs)), bounds=(None, None))
    # Nearly a line, but not quite, since faces must have an area.
    net = 1e-4 * fan_positions(valence)
    net[:, 2] = solution.x
    norm = max(np.linalg.norm(2 * net[a - 1] - net[b - 1] - net[c - 1]) for a, b, c in nets.listed_differences(valence))
    assert norm == pytest.approx(1, abs=PROGRAM_TOLERANCE)

    mesh, face = nets.net_mesh(net), np.array([0])
    distance = nets.largest_distances(mesh, face, 0, "CONTROL", SAMPLES)[0]
    assert printed_lemma_7(valence) * norm < 0.315 < 1 / 3 - PROGRAM_TOLERANCE <= distance
    assert distance <= norm / published_divisor(valence)
    # With a tolerance between the two the printed lemma would leave the face as it is.
    assert face_depths(mesh, 0.32, "SECOND_ORDER", "CONTROL").depths[0] > 0


@pytest.mark.parametrize("valence", [9, 10, 12, 16])
def test_lemma_7_as_printed_is_half_of_theorem_8(valence: int) -> None:
    assert 2 * printed_lemma_7(valence) == pytest.approx(1 / published_divisor(valence))


# Regular patches: Lemmas 1 and 2, and their limit-vertex forms


def regular_stencils() -> tuple[FloatArray, FloatArray]:
    """The 16 differences of a 4×4 net as a matrix over Stam's numbers of valence 4, and the net (4, 4, 16)."""
    net = regular_nets(nets.net_mesh(np.eye(16)), np.array([0]))[:, :, 0]
    rows = [2 * net[a] - net[b] - net[c] for a, b, c in nets.listed_regular_differences()]
    return np.stack(rows), net


@pytest.mark.parametrize(("vertices", "factor"), [("CONTROL", 1 / 3), ("LIMIT", 1 / 4)])
@pytest.mark.parametrize("level", [0, 1, 2])
def test_regular_facets_reach_their_distance_and_no_more(vertices: str, factor: float, level: int) -> None:
    found = largest_of(distance_stencils(4, level, vertices), regular_stencils()[0])
    assert found <= factor / 4**level + PROGRAM_TOLERANCE
    assert found >= 0.74 * factor / 4**level
    net = np.zeros((4, 4, 1, 3))
    net[0, 0] = [0, 0, 1]
    assert second_order_regular(net, Vertices(vertices)).at(level)[0] == pytest.approx(factor / 4**level)


@pytest.mark.parametrize("vertices", ["CONTROL", "LIMIT"])
@pytest.mark.parametrize("level", [0, 1, 2])
def test_regular_facets_lie_within_the_first_order_distance(vertices: str, level: int) -> None:
    factor = float(first_order_regular(net_with_an_edge_of_one(4), Vertices(vertices)).at(level)[0])
    found = largest_of(distance_stencils(4, level, vertices), nets.edge_matrix(4))
    assert found <= factor + PROGRAM_TOLERANCE


def net_with_an_edge_of_one(valence: int) -> FloatArray:
    if valence == 4:
        net = np.zeros((4, 4, 1, 3))
        net[0, 0] = [0, 0, 1]
        return net
    net = np.zeros((2 * valence + 8, 1, 3))
    net[2 * valence + 1, 0, 0] = 1
    return net


# First order


@every_valence
def test_first_order_norm_shrinks_as_derived(valence: int) -> None:
    edges = nets.edge_matrix(valence)
    extraordinary, regular = level_one(valence)
    rate = first_order_rate(valence)
    assert largest_of(edges @ extraordinary, edges) <= rate + PROGRAM_TOLERANCE
    along_i = (regular[1:] - regular[:-1]).reshape(-1, regular.shape[-1])
    along_j = (regular[:, 1:] - regular[:, :-1]).reshape(-1, regular.shape[-1])
    assert largest_of(np.concatenate([along_i, along_j]), edges) <= rate + PROGRAM_TOLERANCE


@pytest.mark.parametrize("valence", [3, 5, 6, 8, 12, 32])
@pytest.mark.parametrize("vertices", ["CONTROL", "LIMIT"])
@pytest.mark.parametrize("level", [0, 1])
def test_extraordinary_facets_lie_within_the_first_order_distance(valence: int, vertices: str, level: int) -> None:
    bounds = first_order_extraordinary(net_with_an_edge_of_one(valence), Vertices(vertices))
    found = largest_of(distance_stencils(valence, level, vertices), nets.edge_matrix(valence))
    assert found <= bounds.at(level)[0] + PROGRAM_TOLERANCE


def test_rates_stay_below_one_for_all_valences() -> None:
    valences = [n for n in range(3, 5000) if n != 4]
    assert max(map(published_rate, valences)) < 0.84
    assert max(map(first_order_rate, valences)) < 0.85
    assert min(map(published_divisor, valences)) >= 1


# Random nets


@settings(max_examples=150, deadline=None)
@given(
    valence=st.integers(3, 14),
    method=st.sampled_from(list(PATCH_METHODS)),
    vertices=st.sampled_from(list(Vertices)),
    seed=st.integers(0, 2**32 - 1),
    flatness=st.sampled_from([0.0, 0.1, 1.0]),
)
def test_random_nets_stay_within_their_bounds(
    valence: int, method: Method, vertices: Vertices, seed: int, flatness: float
) -> None:
    """Distances at levels 0 to 3, sampled at eighths, of nets from nearly flat fans to wild ones."""
    generator = np.random.default_rng(seed)
    noise = generator.standard_t(2, size=(2 * valence + 8, 3)) * generator.uniform(0, 1, 3)
    points = fan_positions(valence) * flatness + noise
    mesh, face = nets.net_mesh(points), np.array([0])
    patch = PATCH_METHODS[method]
    if valence == 4:
        bounds = patch.regular(regular_nets(mesh, face), vertices)
    else:
        bounds = patch.extraordinary(points[:, None], vertices)
    for level in range(4):
        distance = nets.largest_distances(mesh, face, level, vertices, SAMPLES)[0]
        assert distance <= bounds.at(level)[0] * (1 + 1e-12)


def fan_positions(valence: int) -> FloatArray:
    """(2n + 8, 3): a flat net of a size of some units, for noise to be added."""
    around = 2 * np.pi * np.arange(2 * valence) / (2 * valence)
    outer = around[1] * np.array([3, 3.5, 4, 5, 2.5, 2, 1])
    angles = np.concatenate([[0], around, outer])
    radii = np.concatenate([[0], np.tile([1, 1.4], valence), np.full(7, 2.5)])
    return np.stack([radii * np.cos(angles), -radii * np.sin(angles), 0 * radii], axis=1)


# The support


@pytest.mark.parametrize("vertices", ["CONTROL", "LIMIT"])
@pytest.mark.parametrize("name", ["valence 2", "soup", "creases", "two cubes", "closed"])
def test_faces_stay_within_the_bound_of_their_support(name: str, vertices: str) -> None:
    data = {
        "valence 2": meshes.valence_two,
        "soup": meshes.face_soup,
        "creases": lambda: meshes.with_random_creases(meshes.landscape(4, 4), share=0.6),
        "two cubes": meshes.two_cubes_sharing_an_edge,
        "closed": lambda: meshes.bumpy(meshes.trapezohedron(7), 0.3),
    }[name]()
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=True)
    faces = np.arange(mesh.face_count)
    distances = nets.largest_distances(mesh, faces, 0, vertices, 4)
    assert np.all(distances <= support_bounds(mesh, Vertices(vertices)) + ROUNDING)


@pytest.mark.parametrize("vertices", ["CONTROL", "LIMIT"])
@pytest.mark.parametrize("seed", range(6))
def test_faces_on_grids_stay_within_the_bound_of_their_nets(seed: int, vertices: str) -> None:
    """Semi-sharp and infinitely sharp creases and corners on a grid, dense and sparse, straight and turning."""
    generator = np.random.default_rng(seed)
    data = meshes.with_random_creases(meshes.landscape(5, 5), seed=seed, share=(0.1, 0.2, 0.4)[seed % 3])
    mesh = meshes.to_polygon_mesh(data)
    sharpness = np.where(generator.random(mesh.vertex_count) < 0.1, generator.choice([0.5, 1.7, 3.0, 10.0]), 0.0)
    creases = np.where(generator.random(mesh.edge_count) < 0.05, 10.0, mesh.edge_sharpness)
    mesh = mesh.changed(vertex_sharpness=sharpness, edge_sharpness=creases if seed % 2 else mesh.edge_sharpness)
    mesh = apply_boundary_rule(mesh, smooth_corners=bool(seed % 2))
    distances = nets.largest_distances(mesh, np.arange(mesh.face_count), 0, vertices, 4)
    bounds = support_bounds(mesh, Vertices(vertices))
    assert np.all(distances <= bounds + ROUNDING)
    on_grids = faces_on_grids(mesh)
    assert np.any(on_grids & (classify_patches(mesh).kinds == PatchKind.IRREGULAR))
    # Not the size of a face counts then, which is 1, but how far its net is from bilinear.
    flattened = mesh.changed(positions=mesh.positions * [1.0, 1.0, 1e-3])
    assert np.all(support_bounds(flattened, Vertices(vertices))[on_grids] < 0.02)
