"""What a scene does not need, and so is not built or run: DESIGN's rule, as a list with reasons."""

from __future__ import annotations

from kernels.fragments.opacity import VARIES, constant_opacities
from scenes.model import Scene


def opacity_varies(scene: Scene) -> bool:
    """Whether the atlas needs a plane of opacities."""
    return scene.features.blend and bool((constant_opacities(scene) == VARIES).any())


def skipped_stages(scene: Scene) -> dict[str, str]:
    """Stages left out for this scene, name to reason."""
    features = scene.features
    reasons = {
        "textures": (features.textures, "no material has a texture"),
        "normal maps": (features.normal_maps, "no material has a normal map"),
        "vertex colours": (features.vertex_colours, "all vertices are white"),
        "alpha mask": (features.mask, "no material is alpha-masked"),
        "transparency": (features.blend, "no material is blended or lets light through"),
        "alpha plane": (opacity_varies(scene), "no blended material's opacity varies over its triangles"),
        "shadow maps": (features.shadows, "no light casts shadows"),
        "specular": (features.specular, "all materials are fully rough and not metallic"),
        "emission": (features.emissive, "no material emits light"),
        "back-face culling": (features.single_sided, "all materials are double-sided"),
    }
    return {name: reason for name, (needed, reason) in reasons.items() if not needed}
