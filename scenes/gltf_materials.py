"""glTF materials, textures and samplers as the scene model's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Bytes
from shading_atlas_bench.arithmetic.functions import sin_cos
from shading_atlas_bench.arithmetic.matrices import transform
from shading_atlas_bench.scenes.files import reason_of
from shading_atlas_bench.scenes.gltf_document import GltfDocument
from shading_atlas_bench.scenes.gltf_values import LONGEST_NAME, JsonObject, number, numbers, whole
from shading_atlas_bench.scenes.images import read_texture
from shading_atlas_bench.scenes.model import Material, SceneError, Texture
from shading_atlas_bench.scenes.raw import RawScene

_NEAREST = {"magFilter": (9728,), "minFilter": (9728, 9984, 9986)}
_ALPHA_MODES = {"OPAQUE": "opaque", "MASK": "mask", "BLEND": "blend"}
_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}


@dataclass(frozen=True)
class UvSource:
    """Which UV set a texture uses, and its KHR_texture_transform as a float64 (2, 3) matrix or None."""

    channel: int = 0
    transform: tuple[tuple[float, float, float], ...] | None = None

    def apply(self, uvs: Array) -> Array:
        """The UVs, float (V, 2), after the transform."""
        if self.transform is None:
            return uvs
        matrix = np.array(self.transform)
        return transform(matrix, uvs)


class GltfMaterials:
    """Reads materials into a raw scene; each (image, wrap modes, colour space) becomes one texture.

    sources: per material those of its textures' UVs, each once: the base texture's first, then those of others that
        differ, by which a material's `_uv` counts.
    default: index of the material for primitives without one.
    """

    def __init__(self, document: GltfDocument, raw: RawScene) -> None:
        self._document, self._raw = document, raw
        self._images: dict[tuple[int, bool], Bytes | None] = {}
        self._textures: dict[tuple[int, str, str, bool], int] = {}
        self.sources: list[list[UvSource]] = []
        for entry in document.items("materials"):
            raw.materials.append(self._read(entry))
        # The specification's default is full metal, which shows nothing but the sky: a file that says nothing is matt.
        self.default = len(raw.materials)
        raw.materials.append(Material(name="default", base_colour=(0.8, 0.8, 0.8, 1.0)))
        self.sources.append([UvSource()])

    def _read(self, entry: JsonObject) -> Material:
        extensions = entry.get("extensions", {})
        pbr = self._metallic_roughness(entry, extensions)
        sources: list[UvSource] = []
        self.sources.append(sources)
        base_texture, _ = self._texture(pbr.get("baseColorTexture"), sources, True)
        material = Material(
            name=str(entry.get("name", "")),
            base_colour=numbers(pbr, "baseColorFactor", (1, 1, 1, 1)),
            base_texture=base_texture,
            alpha_mode=self._known(_ALPHA_MODES, entry, "alphaMode", "opaque"),
            alpha_cutoff=number(entry, "alphaCutoff", 0.5),
            double_sided=bool(entry.get("doubleSided", False)),
            transmission=self._transmission(extensions.get("KHR_materials_transmission", {})),
            unlit="KHR_materials_unlit" in extensions,
        )
        if not material.unlit:  # of which the extension ignores everything but the base colour
            material = self._shaped(self._glowing(material, entry, sources), entry, pbr, sources)
        sources.extend([UvSource()] * (not sources))
        return material

    def _shaped(self, material: Material, entry: JsonObject, pbr: JsonObject, sources: list[UvSource]) -> Material:
        """The material with what it needs to be lit."""
        normal, occlusion = entry.get("normalTexture"), entry.get("occlusionTexture")
        normal_texture, normal_uv = self._texture(normal, sources, False)
        surface_texture, surface_uv = self._texture(pbr.get("metallicRoughnessTexture"), sources, False)
        occlusion_texture, occlusion_uv = self._texture(occlusion, sources, False)
        return replace(
            material,
            normal_texture=normal_texture,
            normal_uv=normal_uv,
            normal_scale=number(normal or {}, "scale", 1.0),
            roughness=number(pbr, "roughnessFactor", 1.0),
            metallic=number(pbr, "metallicFactor", 1.0),
            surface_texture=surface_texture,
            surface_uv=surface_uv,
            occlusion_texture=occlusion_texture,
            occlusion_uv=occlusion_uv,
            occlusion_strength=number(occlusion or {}, "strength", 1.0),
        )

    def _glowing(self, material: Material, entry: JsonObject, sources: list[UvSource]) -> Material:
        """The material with what it emits."""
        glow = entry.get("extensions", {}).get("KHR_materials_emissive_strength", {})
        strength, factor = number(glow, "emissiveStrength", 1.0), numbers(entry, "emissiveFactor", (0, 0, 0))
        info = entry.get("emissiveTexture") if any(factor) else None
        texture, uv = self._texture(info, sources, True)
        red, green, blue = factor
        if info and texture < 0:
            red = green = blue = 0.0  # its texture says where it glows, so without it nothing does
        emissive = (red * strength, green * strength, blue * strength)
        return replace(material, emissive=emissive, emissive_texture=texture, emissive_uv=uv)

    def _metallic_roughness(self, entry: JsonObject, extensions: JsonObject) -> JsonObject:
        """The core material's parameters; of the older specular-glossiness ones diffuse and gloss are translated."""
        gloss = extensions.get("KHR_materials_pbrSpecularGlossiness")
        if gloss is None:
            core: JsonObject = entry.get("pbrMetallicRoughness", {})
            return core
        ignored = [name for name in ("specularFactor", "specularGlossinessTexture") if name in gloss]
        for name in ignored:
            self._raw.note(f"Materials of KHR_materials_pbrSpecularGlossiness whose {name} is not used: {{}}.")
        pbr: JsonObject = {"metallicFactor": 0.0, "roughnessFactor": 1.0 - number(gloss, "glossinessFactor", 1.0)}
        pbr["baseColorFactor"] = numbers(gloss, "diffuseFactor", (1, 1, 1, 1))
        if "diffuseTexture" in gloss:
            pbr["baseColorTexture"] = gloss["diffuseTexture"]
        return pbr

    def _transmission(self, glass: JsonObject) -> float:
        """The share of light let through; a texture of it is replaced by its mean."""
        factor, info = number(glass, "transmissionFactor", 0.0), glass.get("transmissionTexture")
        texels = self._image_of(info, False) if info and factor else None
        if texels is not None:
            self._raw.note("Textures of transmission, replaced by their mean: {}.")
            factor *= float(texels[..., 0].mean()) / 255
        return factor

    def _texture(self, info: JsonObject | None, sources: list[UvSource], srgb: bool) -> tuple[int, int]:
        """Index of the texture that a material's slot refers to, or -1, and which of the sources its UVs have; one that
        is not among them is added."""
        if not info:
            return -1, 0
        texture = self._index(info, srgb)
        if texture < 0:
            return -1, 0
        source = _uv_source(info)
        if source not in sources:
            sources.append(source)
        return texture, sources.index(source)

    def _index(self, info: JsonObject, srgb: bool) -> int:
        """Index of a texture, read where it is new; -1 where its image cannot be read (noted)."""
        entry, texels = self._document.entry("textures", info["index"]), self._image_of(info, srgb)
        image = _image_index(entry)
        if texels is None or image is None:
            return -1
        sampler = self._document.entry("samplers", entry["sampler"]) if "sampler" in entry else {}
        wrap_s, wrap_t = (self._known(_WRAPS, sampler, side, "repeat") for side in ("wrapS", "wrapT"))
        key = (image, wrap_s, wrap_t, srgb)
        if key not in self._textures:
            nearest = any(sampler.get(name) in values for name, values in _NEAREST.items())
            self._raw.note("Textures whose sampler asks for the nearest texel, interpolated all the same: {}.", nearest)
            self._textures[key] = len(self._raw.textures)
            self._raw.textures.append(Texture(self._name(image), texels, srgb, wrap_s, wrap_t))
        return self._textures[key]

    def _known(self, values: Mapping[Any, str], entry: JsonObject, key: str, default: str) -> str:
        """What a property's value stands for; the default where it is not there, or unknown (noted)."""
        if key in entry and entry[key] not in values:
            self._raw.note(f"An unknown {key} of {entry[key]} is taken for {default}.")
        return values.get(entry.get(key), default)

    def _image_of(self, info: JsonObject, srgb: bool) -> Bytes | None:
        """The texels of a texture's image, read once as colours or as what is none; None where that fails (noted)."""
        index = _image_index(self._document.entry("textures", info["index"]))
        if index is None:
            self._raw.note(f"Texture {info['index']} names no image and is left out.")
            return None
        if (index, srgb) not in self._images:
            self._images[index, srgb] = self._decoded(index, srgb)
        return self._images[index, srgb]

    def _name(self, image: int) -> str:
        return str(self._document.entry("images", image).get("name") or f"image {image}")

    def _decoded(self, index: int, srgb: bool) -> Bytes | None:
        try:
            return read_texture(self._document.image_bytes(index), self._name(index), srgb, self._raw)
        except SceneError:
            raise
        except OSError as error:
            reason = reason_of(error)
        except KeyError as error:
            reason = f"it lacks {error}"
        except ValueError as error:
            reason = str(error)
        self._raw.note(f"Image {index}{self._written(index)} is left out: {reason}.")
        return None

    def _written(self, index: int) -> str:
        """The name of an image's file, or its own, in brackets; nothing where it has neither, or there is no image."""
        image = dict(enumerate(self._document.items("images"))).get(index, {})
        uri = str(image.get("uri", "data:"))
        name = image.get("name", "") if uri.startswith("data:") else uri
        return f" ({name:.{LONGEST_NAME}})" if isinstance(name, str) and name else ""


def _image_index(texture: JsonObject) -> int | None:
    for extension in texture.get("extensions", {}).values():
        if "source" in extension and "source" not in texture:
            texture = extension
            break
    index: int | None = texture.get("source")
    return index


def _uv_source(info: JsonObject) -> UvSource:
    """UV set and transform of a texture reference (KHR_texture_transform: translation, rotation, then scale)."""
    change = info.get("extensions", {}).get("KHR_texture_transform")
    if change is None:
        return UvSource(whole(info, "texCoord", 0))
    (u, v), (su, sv) = numbers(change, "offset", (0, 0)), numbers(change, "scale", (1, 1))
    sine, cosine = (float(part) for part in sin_cos(number(change, "rotation", 0.0)))
    matrix = ((cosine * su, sine * sv, u), (-sine * su, cosine * sv, v))
    return UvSource(whole(change, "texCoord", whole(info, "texCoord", 0)), matrix)
