"""Files of `--dump`: the scene's triangles, and per method and frame what was sent, drawn and expected."""

from __future__ import annotations

import errno
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.arithmetic.arrays import Array, Bytes, Floats, Ints
from shading_atlas_bench.reports.store.names import folder_name

if TYPE_CHECKING:
    from shading_atlas_bench.packers.interface import Owners, View
    from shading_atlas_bench.scenes.model import Scene

Number = TypeVar("Number", bound=np.generic)

PNG_SUB = 16  # libpng's name for the filter `sub` alone: trying all of them takes most of the time


def dump_scene(folder: Path, scene: Scene) -> Path:
    """Write `folder/scene.npz` and return its path.

    It holds `positions` float32 (T, 3, 3) in triangle order, relative to `origin` float64 (3), and `double_sided` and
    `masked` bool (T).
    """
    sided = np.array([material.double_sided for material in scene.materials], bool)
    masked = np.array([material.alpha_mode == "mask" for material in scene.materials], bool)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "scene.npz"
    np.savez(
        path,
        positions=scene.positions[scene.indices].astype(np.float32, copy=False),
        origin=np.asarray(scene.origin, np.float64),
        double_sided=sided[scene.material_ids],
        masked=masked[scene.material_ids],
    )
    return path


def dump_frame(
    folder: Path,
    method: str,
    variant: str,
    index: int,
    *,
    atlas: Bytes | None,
    owners: Owners | None,
    client: Bytes,
    reference: Bytes,
    visibility: Ints,
    novel: View,
    details: Mapping[str, Array] | None = None,
    alpha: Bytes | None = None,
) -> Path:
    """Write `folder/METHOD-HASH/frame_0000.npz` and its pictures, and return the path of the former.

    atlas: uint8 (H, W, 3 or 4) before encoding; owners: of its texels; both None for a method without an atlas, whose
        file then lacks `atlas`, `owner` and `bary`.
    client: uint8 (h, w, 3), drawn from the payload without video coding. reference: uint8 (h, w, 3).
    visibility: int32 (h, w), triangle of the novel view, -1 where empty. novel: the novel view.
    details: the method's own arrays, under their names.
    alpha: the plane of opacities, uint8 (H, W, 3 or 4), grey, before encoding; None where there is none.

    The file holds these (`alpha` as (H, W)), `owner` int32 (H, W) with -1 where no triangle owns a texel, `bary`
    float32 (H, W, 2), and `view` and `projection` float64 (4, 4).
    """
    arrays: dict[str, Array] = {
        "client": _picture(client),
        "reference": _picture(reference),
        "visibility": np.asarray(visibility, np.int32),
        "view": np.asarray(novel.view, np.float64),
        "projection": np.asarray(novel.projection, np.float64),
        **(details or {}),
    }
    if atlas is not None and owners is not None:
        size = (atlas.shape[1], atlas.shape[0])
        arrays |= {"atlas": np.asarray(atlas, np.uint8)}
        arrays |= {"owner": owner_plane(owners, *size), "bary": bary_plane(owners, *size)}
    if alpha is not None:
        arrays["alpha"] = np.asarray(alpha, np.uint8)[..., 0]
    target = folder / folder_name(method, variant)
    target.mkdir(parents=True, exist_ok=True)
    path = target / f"frame_{index:04d}.npz"
    np.savez(path, **arrays)  # type: ignore[arg-type]  # NumPy's stub takes each for its switch allow_pickle, too
    for name in ("atlas", "client", "reference"):
        if name in arrays:
            write_png(target / f"frame_{index:04d}_{name}.png", arrays[name][..., :3])
    if alpha is not None:
        write_png(target / f"frame_{index:04d}_alpha.png", alpha[..., :3])
    return path


def owner_plane(owners: Owners, width: int, height: int) -> Ints:
    """The triangle that owns each texel, int32 (height, width), -1 where none.

    Samples outside the plane are left out; of two owners of one texel the last counts.
    """
    return _scatter(owners, owners.triangle, np.full(width * height, -1, np.int32)).reshape(height, width)


def bary_plane(owners: Owners, width: int, height: int) -> Floats:
    """Barycentrics of each texel's surface point, float32 (height, width, 2), as `owner_plane`; 0 where none."""
    return _scatter(owners, owners.bary, np.zeros((width * height, 2), np.float32)).reshape(height, width, 2)


def _scatter(owners: Owners, values: NDArray[Number], plane: NDArray[Number]) -> NDArray[Number]:
    texel = owners.texel
    if len(texel) and (texel.min() < 0 or texel.max() >= len(plane)):
        inside = (texel >= 0) & (texel < len(plane))
        texel, values = texel[inside], values[inside]
    plane[texel] = values
    return plane


def write_png(path: Path, rgb: Array) -> None:
    """Write a picture, uint8 (h, w, 3), sRGB, as PNG.

    Raises ValueError for another shape or dtype, and OSError if writing fails; both name the file.
    """
    import OpenImageIO

    rgb = np.ascontiguousarray(rgb)
    if rgb.dtype != np.uint8 or rgb.ndim != 3 or rgb.shape[2] != 3:
        raise ValueError(f"{path}: a picture is uint8 (h, w, 3), not {rgb.dtype} {rgb.shape}.")
    spec = OpenImageIO.ImageSpec(rgb.shape[1], rgb.shape[0], 3, OpenImageIO.UINT8)
    # Several times faster than the defaults, for slightly larger files.
    spec.attribute("png:compressionLevel", 1)
    spec.attribute("png:filter", PNG_SUB)
    output = OpenImageIO.ImageOutput.create(str(path))
    if output is None:
        raise OSError(errno.EIO, OpenImageIO.geterror(), str(path))
    if not (output.open(str(path), spec) and output.write_image(rgb) and output.close()):
        raise OSError(errno.EIO, output.geterror(), str(path))


def _picture(image: Bytes) -> Bytes:
    return np.ascontiguousarray(np.asarray(image, np.uint8)[..., :3])
