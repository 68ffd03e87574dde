"""The node tree of a glTF file: which nodes are drawn, and their world matrices."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.arithmetic.matrices import product
from shading_atlas_bench.scenes.gltf_document import GltfDocument
from shading_atlas_bench.scenes.gltf_values import JsonObject, numbers
from shading_atlas_bench.scenes.transforms import compose

AT_REST: dict[str, tuple[float, ...]] = {  # of nodes that say nothing
    "translation": (0, 0, 0),
    "rotation": (0, 0, 0, 1),
    "scale": (1, 1, 1),
}
_IDENTITY = tuple(np.eye(4).ravel().tolist())


class GltfNodes:
    """entries: the nodes' JSON. local, world: float64 (N, 4, 4). parents: list of int, -1 at roots.

    drawn: the nodes of the default scene, each once, in the file's order of children.
    Raises ValueError where the nodes do not form trees.
    """

    def __init__(self, document: GltfDocument) -> None:
        self.entries = document.items("nodes")
        self.parents = [-1] * len(self.entries)
        for index, entry in enumerate(self.entries):
            for child in entry.get("children", []):
                document.entry("nodes", child)
                if self.parents[child] >= 0:
                    raise ValueError(f"node {child} has two parents")
                self.parents[child] = index
        self.local = local_matrices(self.entries)
        roots = [index for index, parent in enumerate(self.parents) if parent < 0]
        self._order = self._descend(roots)  # which never reaches a cycle: its nodes have one parent each, within it
        if len(self._order) != len(self.entries):
            raise ValueError("its node tree has a cycle")
        self.world = self._world_matrices(roots)
        self.drawn = self._descend(_scene_roots(document, roots))

    def _world_matrices(self, roots: list[int]) -> Doubles:
        """World matrices (N, 4, 4) of all nodes, those of one depth at once."""
        world, level = self.local.copy(), self._children(roots)
        while level:
            world[level] = product(world[[self.parents[index] for index in level]], self.local[level])
            level = self._children(level)
        return world

    def _children(self, nodes: list[int]) -> list[int]:
        return [child for node in nodes for child in self.entries[node].get("children", [])]

    def below(self, nodes: Collection[int]) -> dict[int, int]:
        """Some nodes and all below them: how many of these lie from the uppermost one above each down to itself."""
        counts: dict[int, int] = {}
        for node in self._order:  # parents come before children
            above = counts.get(self.parents[node], 0)
            if above or node in nodes:
                counts[node] = above + 1
        return counts

    def lineage(self, node: int, count: int) -> list[int]:
        """The node and those above it, `count` of them, from the uppermost one down."""
        path = [node]
        while len(path) < count:
            path.append(self.parents[path[-1]])
        return path[::-1]

    def _descend(self, roots: list[int]) -> list[int]:
        """The nodes below the roots and these, each once."""
        order, stack = {}, list(reversed(roots))
        while stack:
            index = stack.pop()
            if index not in order:
                order[index] = True
                stack.extend(reversed(self.entries[index].get("children", [])))
        return list(order)


def _scene_roots(document: GltfDocument, roots: list[int]) -> list[int]:
    if not document.items("scenes"):
        return roots
    shown: list[int] = document.entry("scenes", document.json.get("scene", 0)).get("nodes", [])
    for node in shown:
        document.entry("nodes", node)
    return shown


def local_matrices(nodes: list[JsonObject]) -> Doubles:
    """The nodes' local transforms, float64 (N, 4, 4), from their matrices or translations, rotations and scales."""
    local = np.tile(np.eye(4), (len(nodes), 1, 1))
    placed = [number for number, node in enumerate(nodes) if "matrix" not in node and node.keys() & AT_REST.keys()]
    if placed:
        values = ([numbers(nodes[number], name, rest) for number in placed] for name, rest in AT_REST.items())
        local[placed] = compose(*map(np.array, values))
    for number, node in enumerate(nodes):
        if "matrix" in node:
            local[number] = np.array(numbers(node, "matrix", _IDENTITY)).reshape(4, 4).T
    return local
