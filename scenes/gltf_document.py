"""A glTF 2.0 file's container: JSON, buffers, accessors and image bytes (Khronos glTF 2.0, sections 3.6 and 4.4)."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array
from shading_atlas_bench.scenes.files import SceneFiles, is_file
from shading_atlas_bench.scenes.gltf_values import LONGEST_NAME, JsonObject, picked, whole
from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.raw import RawScene

_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
_WIDTHS = {"SCALAR": (1, 1), "VEC2": (1, 2), "VEC3": (1, 3), "VEC4": (1, 4), "MAT2": (2, 2), "MAT3": (3, 3)}
_WIDTHS["MAT4"] = (4, 4)

_LISTS = (
    *("accessors", "animations", "bufferViews", "buffers", "cameras", "images", "materials", "meshes", "nodes"),
    *("samplers", "scenes", "skins", "textures"),
)

# Extensions that are read. A file that requires any other is refused; one that only uses it has a way without.
_READ = {
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "MSFT_texture_dds",
}


class GltfDocument:
    """The parsed JSON with typed access to its binary data.

    json: the document. Indices out of range, missing keys and overruns raise KeyError, IndexError or ValueError,
    which the caller turns into one sentence.
    """

    def __init__(self, path: Path, files: SceneFiles, raw: RawScene) -> None:
        self._path, self._files, self._raw = path, files, raw
        self.json, self._chunk = _parsed(path.read_bytes())
        version = str(self.json.get("asset", {}).get("version", "2.0"))[:LONGEST_NAME]
        if not version.startswith("2"):
            raise SceneError(f"{path} is glTF {version}; only glTF 2.0 can be read, so convert it first.")
        missing = [name for name in self._names("extensionsRequired") if name not in _READ]
        if missing:
            names = " and ".join(missing)[:LONGEST_NAME]
            raise SceneError(f"{path} needs {names}, which cannot be read; export it without.")
        self._buffers: dict[int, bytes | memoryview] = {}
        self._accessors: dict[int, Array] = {}

    def ignored_extensions(self) -> list[str]:
        """Names of the extensions that the file uses and that are not read."""
        return [name for name in self._names("extensionsUsed") if name not in _READ]

    def _names(self, key: str) -> list[str]:
        names = self.json.get(key, [])
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise ValueError(f"its {key} is not a list of names")
        return list(dict.fromkeys(names))

    def items(self, kind: str) -> list[JsonObject]:
        """A top-level list such as "nodes"; empty where the file has none."""
        entries: list[JsonObject] = self.json.get(kind, [])
        return entries

    def entry(self, kind: str, index: int) -> JsonObject:
        """The entry of a top-level list that the file refers to by its number."""
        return picked(self.items(kind), index, kind)

    def accessor(self, index: int, name: str, *kinds: str) -> Array:
        """An accessor's entries: (N,), (N, k) or (N, k, k) for matrices by row; float32 where normalised.

        kinds: the types that it may have, such as "VEC3"; name: what it is for, in the sentence where it has another.
        Raises ValueError then.
        """
        entry = self.entry("accessors", index)
        if entry["type"] not in kinds:
            raise ValueError(f"{name} has entries of type {entry['type']!s:.{LONGEST_NAME}}, not {' or '.join(kinds)}")
        if index not in self._accessors:
            self._accessors[index] = self._read_accessor(entry)
        return self._accessors[index]

    def whole_numbers(self, index: int, name: str, *kinds: str) -> Array:
        """As `accessor`, of unsigned integers only. Raises ValueError for others."""
        values = self.accessor(index, name, *kinds)
        if values.dtype.kind != "u":
            raise ValueError(f"{name} has entries of {values.dtype.name}, not unsigned integers")
        return values

    def has_data(self, index: int) -> bool:
        """Whether an accessor has data of its own; what a decompressor would fill in has none."""
        return "bufferView" in self.entry("accessors", index) or "sparse" in self.entry("accessors", index)

    def image_bytes(self, index: int) -> bytes:
        """An image file's bytes, embedded, from a data URI or from the file beside. Raises ValueError without any."""
        image = self.entry("images", index)
        if "bufferView" in image:
            return bytes(self._view(image["bufferView"]))
        if "uri" not in image:
            raise ValueError("it has neither data nor the name of a file")
        return self._fetch(image["uri"], self._raw.check)

    def _fetch(self, uri: str, count: Callable[[int, str], None]) -> bytes:
        """What a URI stands for. count: called with the bytes of a file before it is read, and what it is."""
        if not isinstance(uri, str):
            raise ValueError(f"the name of a file is {uri!r:.60}, not text")
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2])
            except ValueError as error:
                raise ValueError("the text of a data URI is not base64") from error
        file = self._files.exact(self._path, unquote(uri))
        if not is_file(file):
            raise ValueError(f"{uri:.{LONGEST_NAME}} {self._files.absence(self._path, unquote(uri))}")
        count(file.stat().st_size, f"the file {uri}")
        return file.read_bytes()

    def _view(self, index: int) -> memoryview:
        view = self.entry("bufferViews", index)
        buffer = view["buffer"]
        if buffer not in self._buffers:
            entry = self.entry("buffers", buffer)
            chunk = self._chunk if buffer == 0 else None
            own = chunk if "uri" not in entry else self._fetch(entry["uri"], self._raw.take)
            if own is None:
                compressed = " without " + " and ".join(entry["extensions"]) if entry.get("extensions") else ""
                raise ValueError(f"buffer {buffer} has no data{compressed}")
            if len(own) < (length := whole(entry, "byteLength", 0)):
                found = f"{len(own):,} bytes, fewer than its byteLength of {length:,}"
                raise ValueError(f"buffer {buffer} has {found}; the file is cut off or damaged")
            self._buffers[buffer] = own
        offset, length = whole(view, "byteOffset", 0), whole(view, "byteLength", 0)
        if offset + length > len(self._buffers[buffer]):
            raise ValueError(f"buffer view {index} reaches past the end of its buffer; the file is cut off or damaged")
        return memoryview(self._buffers[buffer])[offset : offset + length]

    def _read_accessor(self, accessor: JsonObject) -> Array:
        component = _component(accessor)
        columns, rows = _WIDTHS[accessor["type"]]
        count = whole(accessor, "count", 0)
        if "bufferView" in accessor:
            stride = self.entry("bufferViews", accessor["bufferView"]).get("byteStride")
            view = self._view(accessor["bufferView"])[whole(accessor, "byteOffset", 0) :]
            values = _strided(view, component, columns, rows, count, stride)
        else:
            self._raw.take(
                count * columns * rows * component.itemsize, f"an accessor of {count:,} entries without data"
            )
            values = np.zeros((count, columns, rows), component)
        if "sparse" in accessor:
            values = self._with_sparse(values.copy(), accessor["sparse"], component)
        if accessor.get("normalized"):
            values = np.maximum(values.astype(np.float32) / np.iinfo(component).max, -1)
        if columns > 1:
            return values.transpose(0, 2, 1)  # stored column by column
        return values[:, 0, 0] if rows == 1 else values[:, 0]

    def _with_sparse(self, values: Array, sparse: JsonObject, component: np.dtype[Any]) -> Array:
        where, what = sparse["indices"], sparse["values"]
        kind = _component(where)
        if kind.kind != "u":
            raise ValueError(f"a sparse accessor has indices of {kind.name}, not unsigned integers")
        count = whole(sparse, "count", 0)
        rows = _strided(self._view(where["bufferView"])[whole(where, "byteOffset", 0) :], kind, 1, 1, count)
        data = self._view(what["bufferView"])[whole(what, "byteOffset", 0) :]
        columns, height = values.shape[1:]
        values[rows[:, 0, 0]] = _strided(data, component, columns, height, count)
        return values


def _component(entry: JsonObject) -> np.dtype[Any]:
    """The type of each number of an accessor. Raises ValueError for one that is none of the format's."""
    kind = entry["componentType"]
    if type(kind) is not int or kind not in _COMPONENTS:
        raise ValueError(f"componentType is {kind!r:.{LONGEST_NAME}}, none of {', '.join(map(str, _COMPONENTS))}")
    return np.dtype("<" + _COMPONENTS[kind])


def _strided(
    view: memoryview, component: np.dtype[Any], columns: int, rows: int, count: int, stride: int | None = None
) -> Array:
    """(count, columns, rows) entries; matrix columns start at multiples of 4 bytes."""
    column_bytes = component.itemsize * rows
    if columns > 1:
        column_bytes = -(-column_bytes // 4) * 4
    stride = stride or column_bytes * columns
    last = (count - 1) * stride + (columns - 1) * column_bytes + component.itemsize * rows
    if count and last > len(view):
        raise ValueError("an accessor reaches past the end of its data; the file is cut off or damaged")
    if count == 0:
        return np.zeros((0, columns, rows), component)
    return np.ndarray((count, columns, rows), component, view, 0, (stride, column_bytes, component.itemsize))


def _parsed(data: bytes) -> tuple[JsonObject, memoryview | None]:
    """The JSON and the binary chunk of a file's bytes; its first ones say whether it is a GLB container."""
    text, chunk = _split_glb(memoryview(data)) if data[:4] == b"glTF" else (data, None)
    if not text:
        raise ValueError("it is empty")
    try:
        document = json.loads(bytes(text))
        if b"\\u" in bytes(text):  # escapes of half a character, which nothing can write again
            document = json.loads(json.dumps(document, ensure_ascii=False).encode(errors="replace"))
    except RecursionError as error:
        raise ValueError("its JSON is nested too deeply") from error
    except UnicodeDecodeError as error:
        raise ValueError("its JSON is not UTF-8") from error
    except json.JSONDecodeError as error:
        raise ValueError(f"its JSON is wrong in line {error.lineno}, column {error.colno}") from error
    if not isinstance(document, dict):
        raise ValueError("its JSON is not an object")
    for kind in _LISTS:
        entries = document.get(kind, [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise ValueError(f"its {kind} are not a list of objects")
    return document, chunk


def _split_glb(data: memoryview) -> tuple[memoryview, memoryview | None]:
    """The JSON and binary chunks of a GLB container."""
    if len(data) < 20:
        raise ValueError("it is cut off")
    text, binary, position = None, None, 12
    while position + 8 <= len(data):
        length, kind = struct.unpack_from("<II", data, position)
        body = data[position + 8 : position + 8 + length]
        if len(body) < length:
            raise ValueError("it is cut off")
        if kind == 0x4E4F534A and text is None:
            text = body
        elif kind == 0x004E4942 and binary is None:
            binary = body
        position += 8 + length
    if text is None:
        raise ValueError("it has no JSON chunk")
    return text, binary
