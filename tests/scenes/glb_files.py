"""Small GLB files for tests, built from arrays."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np

_COMPONENTS = {"i1": 5120, "i2": 5122, "u1": 5121, "u2": 5123, "u4": 5125, "f4": 5126}

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
SQUARE_INDICES = np.array([0, 1, 2, 0, 2, 3], np.uint16)


class Glb:
    """Collects JSON entries and binary data; `accessor` returns the index of a stored array."""

    def __init__(self, **json_entries: object) -> None:
        self.json: dict = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], **json_entries}
        self.data = b""

    def view(self, data: bytes) -> int:
        self.data += b"\0" * (-len(self.data) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, **more: object) -> int:
        values = np.asarray(values)
        kind = "MAT4" if values.ndim == 3 else "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"
        stored = values.transpose(0, 2, 1) if values.ndim == 3 else values
        view = self.view(np.ascontiguousarray(stored).tobytes())
        component = _COMPONENTS[values.dtype.str[1:]]
        entry = {"bufferView": view, "componentType": component, "count": len(values), "type": kind, **more}
        self.json["accessors"].append(entry)
        return len(self.json["accessors"]) - 1

    def square(self, **attributes: np.ndarray) -> dict:
        """A primitive of the unit square in the plane z = 0, facing +z, with more attributes by name."""
        arrays = {"POSITION": SQUARE, **attributes}
        named = {name: self.accessor(values) for name, values in arrays.items()}
        return {"attributes": named, "indices": self.accessor(SQUARE_INDICES)}

    def bytes(self, more_buffers: list[dict] | None = None) -> bytes:
        self.json["buffers"] = [{"byteLength": len(self.data)}, *(more_buffers or [])]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        data = self.data + b"\0" * (-len(self.data) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
        return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks

    def write(self, path: Path, more_buffers: list[dict] | None = None) -> str:
        path.write_bytes(self.bytes(more_buffers))
        return str(path)


def square_scene(*nodes: dict, **json_entries: object) -> Glb:
    """A GLB whose mesh 0 is the unit square, with these nodes (all roots)."""
    glb = Glb(nodes=list(nodes) or [{"mesh": 0}], **json_entries)
    glb.json["meshes"] = [{"primitives": [glb.square()]}]
    return glb


def full_scene(png: bytes) -> Glb:
    """A file in which something refers to every kind of entry."""
    glb = square_scene({"mesh": 0}, {"mesh": 0, "skin": 0}, {"camera": 0}, {"extensions": {}})
    glb.json["nodes"][3]["extensions"] = {"KHR_lights_punctual": {"light": 0}}
    primitive = glb.json["meshes"][0]["primitives"][0]
    attributes: dict[str, np.ndarray] = {
        "TEXCOORD_0": SQUARE[:, :2],
        "JOINTS_0": np.zeros((4, 4), np.uint8),
        "WEIGHTS_0": np.array([[1, 0, 0, 0]] * 4, np.float32),
    }
    primitive["attributes"] |= {name: glb.accessor(values) for name, values in attributes.items()}
    primitive["material"] = 0
    times, turns = glb.accessor(np.array([0, 1], np.float32)), glb.accessor(np.array([[0, 0, 0, 1]] * 2, np.float32))
    channel = {"sampler": 0, "target": {"node": 2, "path": "rotation"}}
    glb.json |= {
        "scenes": [{"nodes": [0, 1, 2, 3]}],
        "scene": 0,
        "skins": [{"joints": [0]}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1.0}}],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point"}]}},
        "samplers": [{}],
        "images": [{"bufferView": glb.view(png)}],
        "textures": [{"source": 0, "sampler": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "animations": [{"samplers": [{"input": times, "output": turns}], "channels": [channel]}],
    }
    return glb
