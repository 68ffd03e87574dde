"""Images through OpenImageIO, from files and from bytes inside other files."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from functools import cache, reduce
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.arithmetic.arrays import Array, Bytes, Longs
from shading_atlas_bench.arithmetic.functions import power
from shading_atlas_bench.errors import BenchError
from shading_atlas_bench.scenes.files import is_utf8
from shading_atlas_bench.scenes.raw import RawScene

if TYPE_CHECKING:
    from OpenImageIO import ImageInput

_LARGEST = 1 << 28  # texels; anything above is a damaged header, not a texture
_LARGEST_BYTES = 1 << 31  # of such an image as it is stored: some formats are only read whole
_ROWS = 64  # that are read at a time
_LIGHT = ("openexr", "hdr")  # formats of light itself, as OpenImageIO calls them
_FULL = 65535  # light is counted in whole numbers up to it while texels are averaged


class ImageError(BenchError, ValueError):
    """An image that cannot be read; the message is one sentence."""


def read_texture(source: Path | bytes, name: str, srgb: bool, raw: RawScene) -> Bytes:
    """The texels of a texture, as of `read_image`, no side longer than the raw scene's `max_texture`: its mip level
    that fits, made while it is read, which is noted under this name.

    srgb: whether its colours are sRGB, so that light is averaged and not their codes. Raises ImageError where it
    cannot be read, and SceneError where the textures do not fit into memory.
    """
    texels, width, height = _read(source, raw.max_texture, srgb)
    raw.take(texels.nbytes, "all its textures", "give a smaller --max-texture")
    rows, columns = texels.shape[:2]
    if (columns, rows) != (width, height):
        raw.note(f"The texture {name} of {width}x{height} is reduced to {columns}x{rows} (--max-texture).")
    return texels


def read_image(source: Path | bytes) -> Bytes:
    """The texels of an image file, or of such a file's bytes: uint8 (H, W, 4), row 0 on top, alpha not premultiplied.

    Greyscale becomes RGB; a missing alpha is 255. Raises ImageError where it cannot be read.
    """
    return _read(source, None, True)[0]


def _read(source: Path | bytes, most: int | None, srgb: bool) -> tuple[Bytes, int, int]:
    """The texels, sides no longer than `most`, and the width and height that the image is stored with."""
    if isinstance(source, Path):  # OpenImageIO takes names in UTF-8 only
        return _read_file(source, most, srgb) if is_utf8(source) else _read(source.read_bytes(), most, srgb)
    handle, name = tempfile.mkstemp(suffix=_suffix(source))  # and no bytes in every format
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(source)
        return _read_file(Path(name), most, srgb)
    finally:
        Path(name).unlink()


def _read_file(path: Path, most: int | None, srgb: bool) -> tuple[Bytes, int, int]:
    import OpenImageIO

    config = OpenImageIO.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = OpenImageIO.ImageInput.open(str(path), config)
    if source is None:
        raise ImageError(f"the image cannot be read ({_first_line(OpenImageIO.geterror())})")
    try:
        spec = source.spec()
        width, height, stored = spec.width, spec.height, spec.image_bytes(native=True)
        if width < 1 or height < 1 or width * height > _LARGEST or stored > _LARGEST_BYTES:
            raise ImageError(f"the image has an unusable size of {width}x{height}")
        halvings = 0
        while most is not None and max(width, height) >> halvings > most:
            halvings += 1
        encoded = srgb and _is_light(source)
        if not halvings:
            return _to_rgba(_whole(source, encoded)), width, height
        whole = _whole(source, encoded) if spec.tile_width else None

        def rows(start: int, end: int) -> Bytes:
            return _read_rows(source, start, end, encoded) if whole is None else whole[start:end]

        return _reduced(rows, width, height, halvings, srgb), width, height
    finally:
        source.close()


def _is_light(source: ImageInput) -> bool:
    """Whether an image holds light itself, no codes: EXR and HDR files do, and others of fractions that say so.

    What PNG and JPEG files say is not asked for: it does not count (glTF 2.0, section 3.8.2).
    """
    from OpenImageIO import FLOAT, HALF

    spec = source.spec()
    says_so = spec.get_string_attribute("oiio:ColorSpace").lower().startswith("lin")
    return source.format_name() in _LIGHT or (says_so and spec.format.basetype in (FLOAT, HALF))


def _whole(source: ImageInput, encoded: bool) -> Bytes:
    """All texels, uint8 (H, W, up to 4). encoded: whether light becomes sRGB."""
    from OpenImageIO import FLOAT, UINT8

    spec = source.spec()
    if encoded and not spec.tile_width:  # as fractions they take four times the memory
        starts = range(0, spec.height, _ROWS)
        return np.concatenate([_read_rows(source, n, min(n + _ROWS, spec.height), True) for n in starts])
    channels = min(spec.nchannels, 4)
    texels = _checked(source, source.read_image(0, 0, 0, channels, FLOAT if encoded else UINT8))
    return _in_bytes(texels.reshape(spec.height, spec.width, channels))


def _read_rows(source: ImageInput, start: int, end: int, encoded: bool) -> Bytes:
    """Some rows of an image that is not stored in tiles, uint8 (end - start, W, up to 4), as of `_whole`."""
    from OpenImageIO import FLOAT, UINT8

    spec = source.spec()
    channels, top = min(spec.nchannels, 4), spec.y
    texels = source.read_scanlines(0, 0, top + start, top + end, 0, 0, channels, FLOAT if encoded else UINT8)
    return _in_bytes(_checked(source, texels).reshape(end - start, spec.width, channels))


def _in_bytes(texels: Array) -> Bytes:
    """Bytes as they are; light (n, W, channels) in fractions as the nearest sRGB, what is no number as black."""
    if texels.dtype == np.uint8:
        return texels
    return _texels(np.rint(np.clip(np.nan_to_num(texels), 0, 1) * np.float32(_FULL)).astype(np.int64), True)


def _checked(source: ImageInput, texels: object) -> Array:
    if texels is None:
        raise ImageError(f"the image is damaged ({_first_line(source.geterror())})")
    return np.asarray(texels)


def _reduced(rows: Callable[[int, int], Bytes], width: int, height: int, halvings: int, srgb: bool) -> Bytes:
    """A mip level of an image, uint8 (h, w, 4); each texel is the mean of those that it covers.

    rows: a function for rows from one number up to another, which are asked for in order.
    """
    columns, lines = max(1, width >> halvings), max(1, height >> halvings)
    left, upper = (np.arange(few + 1) * many // few for few, many in ((columns, width), (lines, height)))
    reduced = np.empty((lines, columns, 4), np.uint8)
    at_once = max(1, _ROWS >> halvings)
    for first in range(0, lines, at_once):
        edges = upper[first : first + at_once + 1]
        if at_once > 1:
            light = _sums(_light(rows(edges[0], edges[-1]), srgb), edges - edges[0], 0)
        else:
            light = _tall(rows, edges[0], edges[-1], srgb)
        area = np.diff(edges)[:, None, None] * np.diff(left)[:, None]
        mean = (_sums(light, left, 1) + area // 2) // area
        reduced[first : first + at_once] = _to_rgba(_texels(mean, srgb))
    return reduced


def _sums(light: Array, edges: Longs, axis: int) -> Array:
    """Sums over rows (axis 0) or columns (1) from each edge up to the next, as many as there are edges but one."""
    spans = np.diff(edges)
    if (spans != spans[0]).any():
        return np.add.reduceat(light, edges[:-1], axis=axis, dtype=light.dtype)
    slices = (light[start :: spans[0]] if axis == 0 else light[:, start :: spans[0]] for start in range(spans[0]))
    return reduce(np.add, slices)


def _tall(rows: Callable[[int, int], Bytes], start: int, end: int, srgb: bool) -> Longs:
    """The light of some rows together, int64 (1, W, channels), from a few of them at a time."""
    parts = (_light(rows(top, min(top + _ROWS, end)), srgb) for top in range(start, end, _ROWS))
    whole: Longs = sum(part.sum(axis=0, dtype=np.int64, keepdims=True) for part in parts)
    return whole


def _light(texels: Bytes, srgb: bool) -> NDArray[np.uint32]:
    """Light of texels (n, W, channels), alpha as it is, from 0 to `_FULL`."""
    light = np.take(_tables(srgb)[0], texels)
    if srgb and (alpha := _alpha(texels)) is not None:
        light[..., alpha] = np.take(_tables(False)[0], texels[..., alpha])
    return light


def _texels(light: Longs, srgb: bool) -> Bytes:
    """The inverse of `_light`."""
    texels = np.take(_tables(srgb)[1], light)
    if srgb and (alpha := _alpha(light)) is not None:
        texels[..., alpha] = np.take(_tables(False)[1], light[..., alpha])
    return texels


def _alpha(texels: Array) -> int | None:
    """Which of the channels, the last axis, is alpha."""
    channels = texels.shape[-1]
    return channels - 1 if channels in (2, 4) else None


@cache
def _tables(srgb: bool) -> tuple[NDArray[np.uint32], Bytes]:
    """The light of each byte, uint32 (256), and the byte whose light is nearest to each, uint8 (65536)."""
    byte = np.arange(256) / 255
    linear = np.where(byte <= 0.04045, byte / 12.92, power((byte + 0.055) / 1.055, 2.4)) if srgb else byte
    light = np.rint(linear * _FULL).astype(np.int64)
    between = (light[:-1] + light[1:]) // 2
    return light.astype(np.uint32), np.searchsorted(between, np.arange(_FULL + 1)).astype(np.uint8)


def _to_rgba(texels: Bytes) -> Bytes:
    channels = texels.shape[2]
    if channels == 4:
        return texels
    rgba = np.full((*texels.shape[:2], 4), 255, np.uint8)
    rgba[..., :3] = texels[..., :3] if channels == 3 else texels[..., :1]
    if channels == 2:
        rgba[..., 3] = texels[..., 1]
    return rgba


def _suffix(data: bytes) -> str:
    known = {b"\x89PNG": ".png", b"\xff\xd8": ".jpg", b"RIFF": ".webp", b"DDS ": ".dds", b"BM": ".bmp", b"GIF8": ".gif"}
    return next((suffix for magic, suffix in known.items() if data.startswith(magic)), ".image")


def _first_line(message: str) -> str:
    return message.strip().splitlines()[0] if message.strip() else "unknown format"
