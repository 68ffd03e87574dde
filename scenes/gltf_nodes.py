"""The node tree of a glTF file: which nodes are drawn, and their world matrices."""

from __future__ import annotations

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
        self.local: Doubles = np.array([local_matrix(entry) for entry in self.entries]).reshape(-1, 4, 4)
        roots = [index for index, parent in enumerate(self.parents) if parent < 0]
        order = self._descend(roots)  # which never reaches a cycle: its nodes have one parent each, within it
        if len(order) != len(self.entries):
            raise ValueError("its node tree has a cycle")
        self.world = self.world_matrices(self.local, order)
        self.drawn = self._descend(_scene_roots(document, roots))

    def world_matrices(self, local: Doubles, order: list[int]) -> Doubles:
        """World matrices for local ones, (N, 4, 4) of all nodes; `order` has parents before children and every ancestor
        of its nodes."""
        world = local.copy()
        for index in order:
            if self.parents[index] >= 0:
                world[index] = product(world[self.parents[index]], local[index])
        return world

    def lineage(self, node: int) -> list[int]:
        """The node's ancestors from the root down to itself."""
        path = []
        while node >= 0:
            path.append(node)
            node = self.parents[node]
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


def local_matrix(node: JsonObject) -> Doubles:
    """A node's local transform, float64 (4, 4), from its matrix or its translation, rotation and scale."""
    if "matrix" in node:
        return np.array(numbers(node, "matrix", _IDENTITY)).reshape(4, 4).T
    if not node.keys() & {"translation", "rotation", "scale"}:
        return np.eye(4)
    return compose(*(np.array([numbers(node, name, default)]) for name, default in AT_REST.items())).reshape(4, 4)
