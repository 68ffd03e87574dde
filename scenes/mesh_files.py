"""OBJ with MTL, PLY, STL and OFF files, read by trimesh's format readers.

The readers are called below trimesh's mesh objects, which would merge vertices, decode images with another library and
cannot hold vertices that are not numbers; cleaning is scenes/assemble.py's, images are scenes/images.py's.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from arithmetic.functions import power
from scenes.files import beside
from scenes.images import read_image
from scenes.model import Material, SceneError, Texture
from scenes.mtl import material_libraries, read_mtl
from scenes.polygons import triangulate
from scenes.raw import Part, RawScene


def read_mesh_file(path: Path) -> RawScene:
    """All triangles of an OBJ, PLY, STL or OFF file with its materials and textures.

    Raises SceneError or, for damaged files, whatever trimesh raises.
    """
    raw = RawScene()
    if path.suffix.lower() == ".obj":
        _read_obj(path, raw)
    else:
        _read_single(path, raw)
    return raw


def _read_obj(path: Path, raw: RawScene) -> None:
    from trimesh.exchange.obj import load_obj

    data = path.read_bytes()
    libraries = material_libraries(data)
    text = normalise_obj(data.decode("utf-8", errors="replace"))
    names = sorted(set(re.findall(r"^usemtl (.*)$", text, re.MULTILINE)))
    # trimesh tells which faces use which material only where it finds the material: give it one of each name.
    known = "\n".join(f"newmtl {name}\nKd 1 1 1" for name in names)
    text = re.sub(r"^mtllib.*$", "", text, flags=re.MULTILINE)
    loaded = load_obj(io.StringIO(f"mtllib names\n{text}"), resolver={"names": known.encode()})
    materials = _obj_materials(path, libraries, names, raw)
    geometry = loaded.get("geometry", {})
    for mesh in geometry.values():
        visual = mesh.get("visual")
        name = getattr(getattr(visual, "material", None), "name", None)
        uvs = getattr(visual, "uv", None)
        raw.parts.append(_part(mesh, materials.get(name, materials[None]), uvs))


def normalise_obj(text: str) -> str:
    """OBJ text as trimesh's reader expects it: single blanks, whole lines, no comments, triangles or quadrilaterals.

    Larger polygons are cut into triangles, also where they are concave. Indices counted backwards are resolved against
    the vertices before their line, as the format defines them.
    """
    text = text.replace("\r\n", "\n").replace("\r", "\n").replace("\\\n", " ")
    text = re.sub(r"(^|[ \t])#.*", "", text, flags=re.MULTILINE)
    text = re.sub(r"[ \t\f\v]+", " ", text) if "\t" in text or "  " in text else text
    text = re.sub(r"^ +| +$", "", text, flags=re.MULTILINE)
    odd = re.search(r"^f (.*-|[^ \n]+( [^ \n]+){4})", text, re.MULTILINE)
    return _rewritten_faces(text) if odd else text


def _rewritten_faces(text: str) -> str:
    lines = text.split("\n")
    points = [line[2:].split()[:3] for line in lines if line.startswith("v ")]
    counts = {"v": 0, "vt": 0, "vn": 0}
    for number, line in enumerate(lines):
        kind, _, rest = line.partition(" ")
        if kind in counts:
            counts[kind] += 1
        elif kind == "f":
            corners = [_forward(corner, tuple(counts.values())) for corner in rest.split()]
            lines[number] = "\n".join(f"f {face}" for face in _cut(corners, points))
    return "\n".join(lines)


def _forward(corner: str, counts: tuple[int, ...]) -> str:
    fields = corner.split("/")
    pairs = zip(fields, counts, strict=False)
    return "/".join(str(count + 1 + int(field)) if field.startswith("-") else field for field, count in pairs)


def _cut(corners: list[str], points: list[list[str]]) -> list[str]:
    """Corners of one polygon as those of its triangles."""
    if len(corners) < 5:
        return [" ".join(corners)]
    numbers = [int(corner.split("/")[0]) - 1 for corner in corners]
    if min(numbers) < 0 or max(numbers) >= len(points):
        raise IndexError(f"a face uses vertex {max(numbers) + 1} of {len(points)}")
    triangles = triangulate(np.array([points[number] for number in numbers], np.float64))
    return [" ".join(corners[i] for i in triangle) for triangle in triangles]


def _obj_materials(path: Path, libraries: list[str], names: list[str], raw: RawScene) -> dict[str | None, int]:
    """Material index by name, read from the libraries; grey for names without a definition, and for None."""
    found: dict[str, Material] = {}
    for library in libraries:
        file = beside(path, library)
        if file.is_file():
            found |= read_mtl(file, raw)
        else:
            raw.note(f"The material library {library} is missing; its materials are grey.")
    index: dict[str | None, int] = {None: 0}
    raw.materials.append(Material(name="default", double_sided=True))
    for name in names:
        index[name] = len(raw.materials)
        raw.materials.append(found.get(name, Material(name=name, double_sided=True)))
    return index


def _read_single(path: Path, raw: RawScene) -> None:
    from trimesh.exchange.load import mesh_loaders

    kind = path.suffix.lower()[1:]
    options = {"skip_materials": True} if kind == "ply" else {}
    with path.open("rb") as file:
        mesh = mesh_loaders[kind](file, file_type=kind, **options)
    material = Material(name="default", double_sided=True)
    picture = ply_texture(path) if kind == "ply" else None
    if picture is not None:
        _add_picture(picture, material, raw)
    raw.materials.append(material)
    for entry in mesh["geometry"].values() if "geometry" in mesh else [mesh]:
        raw.parts.append(_part(entry, 0, getattr(entry.get("visual"), "uv", None)))


def _add_picture(picture: Path, material: Material, raw: RawScene) -> None:
    try:
        raw.textures.append(Texture(picture.name, read_image(picture)))
        material.base_texture, material.base_colour = 0, (1.0, 1.0, 1.0, 1.0)
    except ValueError as error:
        raw.note(f"The texture {picture.name} is left out: {error}.")


def ply_texture(path: Path) -> Path | None:
    """The image named in a PLY header's comment, as common tools write it."""
    with path.open("rb") as file:
        header = file.read(4096).partition(b"end_header")[0].decode("latin-1")
    match = re.search(r"^comment TextureFile (.+)$", header, re.MULTILINE | re.IGNORECASE)
    return beside(path, match[1].strip()) if match else None


def _part(mesh: dict, material: int, uvs: np.ndarray | None) -> Part:
    """A part from trimesh's arrays; v is turned, because these formats count it from an image's lower edge."""
    if mesh.get("faces") is None or not len(mesh["faces"]):
        return Part(np.zeros((0, 3)), np.zeros((0, 3), np.int64), material)
    positions, indices = np.asarray(mesh["vertices"], np.float64), np.asarray(mesh["faces"], np.int64)
    if indices.ndim != 2 or indices.shape[1] < 3 or positions.shape[1:] != (3,):
        raise SceneError("Its faces are not polygons that can be read.")
    fan = [corner for second in range(1, indices.shape[1] - 1) for corner in (0, second, second + 1)]
    indices = indices[:, fan].reshape(-1, 3)
    part = Part(positions, indices, material, colours=_colours(mesh, len(positions)))
    normals = mesh.get("vertex_normals")
    if normals is not None and np.shape(normals) == positions.shape:
        part.normals = np.asarray(normals, np.float64)
    if uvs is not None and len(uvs) == len(positions):
        part.uvs = np.stack([uvs[:, 0], 1 - uvs[:, 1]], axis=1)
    if part.colours is None and mesh.get("face_colors") is not None and len(mesh["face_colors"]) == len(mesh["faces"]):
        per_face = np.repeat(mesh["face_colors"], len(indices) // len(mesh["faces"]), axis=0)
        part = part.taking(indices.ravel(), np.arange(indices.size).reshape(-1, 3))
        part.colours = _linear(np.repeat(per_face, 3, axis=0))
    return part


def _colours(mesh: dict, count: int) -> np.ndarray | None:
    colours = mesh.get("vertex_colors")
    return _linear(np.asarray(colours)) if colours is not None and len(colours) == count else None


def _linear(colours: np.ndarray) -> np.ndarray:
    """Linear RGBA float32 from sRGB in bytes or 0..1, as these formats keep colours."""
    values = np.asarray(colours, np.float64) / (255 if np.asarray(colours).dtype.kind in "ui" else 1)
    linear = np.ones((len(values), 4), np.float32)
    linear[:, : values.shape[1]] = values
    rgb = np.clip(linear[:, :3], 0, 1)
    linear[:, :3] = np.where(rgb <= 0.04045, rgb / 12.92, power((rgb + 0.055) / 1.055, 2.4))
    return linear
