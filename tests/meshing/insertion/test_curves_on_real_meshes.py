"""Curves on meshes as people have them: zones and tips are those that were drawn, on the surface or off."""

from pathlib import Path

import numpy as np
import pytest
from cut_meshes import check_sound, cut, data_mesh, mean_edge, polyline, zones_and_tips

CURVES = Path(__file__).parents[3] / "examples" / "curves"


def drawn_curves(name, shift=0.0):
    """Return the curves that the examples have for a mesh, moved by ``shift``."""
    places = [np.load(file) + shift for file in sorted(CURVES.glob(f"{name}-*.npy"))]
    return [polyline(points, bool((points[0] == points[-1]).all())) for points in places]


@pytest.mark.parametrize("off", [0.0, 0.5, 1.0])
def test_nefertiti_has_eleven_zones_and_eight_tips(off):
    mesh = data_mesh("nefertiti-lowres.obj")
    shift = off * mean_edge(mesh) * np.array([0.6, -0.64, 0.48])
    result = cut(mesh, *drawn_curves("nefertiti", shift))
    assert zones_and_tips(result.mesh) == (11, 8)
    assert result.empty == ()
    check_sound(mesh, result.mesh)


def test_spot_has_as_many_zones_as_rings():
    mesh = data_mesh("spot.obj")
    rings = drawn_curves("spot")
    assert zones_and_tips(cut(mesh, *rings).mesh) == (1 + len(rings), 0)


class Section:
    """Lines in which a plane cuts a mesh, and the parts into which it cuts it."""

    def __init__(self, mesh, rng):
        normal = rng.normal(size=3)
        inside = mesh.vertices[rng.integers(len(mesh.vertices))] + mean_edge(mesh) * rng.uniform(-0.5, 0.5, 3)
        self.mesh, self.height = mesh, (mesh.vertices - inside) @ normal / np.linalg.norm(normal)

    def lines(self):
        """Yield the points of each line and whether it is closed."""
        above = self.height[self.mesh.cells] > 0
        links, places = {}, {}
        for cell in self.mesh.cells[above.any(axis=1) & ~above.all(axis=1)].tolist():
            ends = []
            for a, b in ((cell[0], cell[1]), (cell[1], cell[2]), (cell[2], cell[0])):
                if (self.height[a] > 0) != (self.height[b] > 0):
                    a, b = min(a, b), max(a, b)
                    t = self.height[a] / (self.height[a] - self.height[b])
                    places[a, b] = (1 - t) * self.mesh.vertices[a] + t * self.mesh.vertices[b]
                    ends.append((a, b))
            for one, other in (ends, ends[::-1]):
                links.setdefault(one, []).append(other)
        seen = set()
        for start in sorted(links, key=lambda edge: len(links[edge])):
            if start not in seen:
                line = [start]
                while ahead := [edge for edge in links[line[-1]] if edge not in seen and edge not in line[-2:]]:
                    seen.add(line[-1])
                    line.append(ahead[0])
                seen.add(line[-1])
                yield np.array([places[edge] for edge in line]), len(links[start]) == 2


def vertex_normals(mesh):
    corners = mesh.vertices[mesh.cells]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros_like(mesh.vertices)
    for k in range(3):
        np.add.at(total, mesh.cells[:, k], across)
    return total / np.linalg.norm(total, axis=1)[:, None]


def wrong_sections(mesh, seeds):
    """Return the seeds at which a line of a section, drawn up to an edge off the mesh, left other zones or tips."""
    from scipy.spatial import cKDTree

    normals, tree, edge, wrong, tried = vertex_normals(mesh), cKDTree(mesh.vertices), mean_edge(mesh), [], 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        lines = [points for points, closed in Section(mesh, rng).lines() if closed and len(points) > 12]
        if not lines:
            continue
        points, closed = lines[rng.integers(len(lines))], bool(rng.integers(2))
        points = points if closed else points[: max(6, int(0.6 * len(points)))]
        waves = np.sin(rng.uniform(0.05, 1) * np.arange(len(points)))
        off = edge * rng.choice([0, 0.3, 1]) * [np.ones(len(points)), waves][rng.integers(2)]
        result = cut(mesh, polyline(points + off[:, None] * normals[tree.query(points)[1]], closed))
        joined = result.counts.get("joined", 0) + result.counts.get("pruned", 0)
        tried += 1
        if zones_and_tips(result.mesh) != ((2, 0) if closed else (1, 2)) and not joined:
            wrong.append(seed)
    return wrong, tried


def test_random_sections_of_spot():
    wrong, tried = wrong_sections(data_mesh("spot.obj"), range(10))
    assert tried > 6
    assert not wrong


@pytest.mark.slow
def test_many_random_sections_of_spot():
    wrong, tried = wrong_sections(data_mesh("spot.obj"), range(200))
    assert len(wrong) <= 0.01 * tried


@pytest.mark.parametrize("name", ["mountain.obj", "plane_holes.obj"])
def test_sections_of_open_meshes(name):
    """A plane parts a mesh into as many zones as it parts its vertices, whether lines end at rims or past them."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    mesh = data_mesh(name)
    for seed in range(2):
        section = Section(mesh, np.random.default_rng(seed))
        ends = mesh.facets.reshape(-1, 2)
        ends = ends[(section.height[ends[:, 0]] > 0) == (section.height[ends[:, 1]] > 0)]
        graph = coo_array((np.ones(len(ends)), ends.T), (len(mesh.vertices),) * 2)
        zones = len(np.unique(connected_components(graph, directed=False)[1][np.unique(mesh.cells)]))
        lines = []
        for points, closed in section.lines():
            past = [2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]]
            lines.append(polyline(np.concatenate(past) if seed % 2 and not closed else points, closed))
        after = cut(mesh, *lines).mesh
        assert zones_and_tips(after) == (zones, 0)
        check_sound(mesh, after)
