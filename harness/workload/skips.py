"""What a scene, a frame or a run does not need, and so is not built or run: each skip, and what decides it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.scenes.model import Features

if TYPE_CHECKING:
    from shading_atlas_bench.packers.interface import Packer

# Parts of a frame's work, in which `bench run --explain` measures what a skip saves.
PICTURE, SET, PACKING, METRICS = "reference", "visible set", "packing", "metrics"


@dataclass(frozen=True)
class Skip:
    """One thing that may be left out.

    what: that is not done. unneeded: why, where it applies. needed: why not, where it does not. parts: of a frame's
    work that it shortens. feature: of the scene that decides it; empty where that depends on the frame.
    """

    name: str
    what: str
    unneeded: str
    needed: str
    parts: tuple[str, ...]
    feature: str = ""


DRAWN = (PICTURE, SET)
SHADED = (PICTURE, PACKING)
SKIPS = (
    Skip("textures", "texture lookups", "no material has a texture", "materials have textures", SHADED, "textures"),
    Skip(
        "normal maps",
        "tangents and bumped normals",
        "no material has a normal map",
        "materials have normal maps",
        SHADED,
        "normal_maps",
    ),
    Skip(
        "environment map",
        "reflections of the scene, looked up in an environment map",
        "all materials are of roughness 0.8 or more",
        "materials are glossy",
        SHADED,
        "glossy",
    ),
    Skip("shadows", "shadow lookups", "no light casts shadows", "lights cast shadows", SHADED, "shadows"),
    Skip(
        "alpha mask",
        "alpha tests in the rasteriser",
        "no material is alpha-masked",
        "materials are alpha-masked",
        DRAWN,
        "mask",
    ),
    Skip(
        "blending",
        "transparency: lists of fragments, their shading and compositing, on the server and on clients",
        "no material is blended or lets light through",
        "materials are blended or let light through",
        DRAWN,
        "blend",
    ),
    Skip(
        "clusters",
        "set-up of triangles whose cluster lies outside the view",
        "clusters lie outside views",
        "",
        DRAWN,
    ),
    Skip(
        "set views",
        "views of the cell all of whose triangles are known to be visible",
        "views added nothing",
        "every view adds triangles",
        (SET,),
    ),
    Skip(
        "packing",
        "the whole pack where it would give the last payload again",
        "neither camera nor visible set changed, twice in a row",
        "the camera moves, or the method's payload changes all the same",
        (PACKING,),
    ),
    Skip(
        "metrics",
        "metrics that were not asked for",
        "--metrics leaves some out",
        "all metrics are asked for",
        (METRICS,),
    ),
)
# Without a choice: not built, because the scene shows that it cannot change a pixel.
ALWAYS = {
    "vertex_colours": ("vertex colours", "all vertices are white"),
    "specular": ("specular", "all materials are fully rough and not metallic"),
    "emissive": ("emission", "no material emits light"),
    "surface_maps": ("surface maps", "no material has a texture of roughness and metalness"),
    "occlusion": ("occlusion", "no material has an occlusion texture"),
    "unlit": ("unlit surfaces", "no material is unlit"),
    "further_uvs": ("further UVs", "all textures of a surface use the same UVs"),
    "varying_opacity": ("alpha plane", "no blended material's opacity varies over its triangles"),
    "single_sided": ("back-face culling", "all materials are double-sided"),
}


def known_skips(packers: Iterable[Packer]) -> tuple[Skip, ...]:
    """The skips of the suite and of these packers."""
    own: dict[str, Skip] = {}
    for packer in packers:
        for name, (what, unneeded, needed) in packer.skips.items():
            own[name] = Skip(name, f"{packer.name}: {what}", unneeded, needed, (f"{PACKING} by {packer.name}",))
    return (*SKIPS, *own.values())


def check_names(names: Iterable[str], packers: Iterable[Packer]) -> None:
    """Raise InputError for a name that no skip has, listing those that there are."""
    known = [skip.name for skip in known_skips(packers)]
    for name in names:
        if name not in known:
            near = get_close_matches(name, known, 1, 0.5)
            guess = f" Did you mean {near[0]!r}?" if near else ""
            raise InputError(f"There is no skip {name!r}.{guess} There are: {', '.join(known)}.")


def skipped_stages(features: Features, off: Iterable[str] = ()) -> dict[str, str]:
    """Stages left out for a scene with these features, name to reason; `off` are forced to run."""
    named = {skip.feature: (skip.name, skip.unneeded) for skip in SKIPS if skip.feature and skip.name not in off}
    return {name: reason for feature, (name, reason) in (named | ALWAYS).items() if not getattr(features, feature)}
