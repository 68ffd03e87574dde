"""Images through OpenImageIO, from files and from bytes inside other files."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, reduce
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.arithmetic.arrays import Array, Bytes, Longs
from shading_atlas_bench.arithmetic.functions import power
from shading_atlas_bench.errors import BenchError
from shading_atlas_bench.scenes.files import reason_of
from shading_atlas_bench.scenes.raw import RawScene

if TYPE_CHECKING:
    from OpenImageIO import ImageInput

_LARGEST = 1 << 28  # texels; anything above is a damaged header, not a texture
_LARGEST_BYTES = 1 << 31  # of such an image as it is stored: some formats are only read whole
_ROWS = 64  # that are read at a time
_LIGHT = ("openexr", "hdr")  # formats of light itself, as OpenImageIO calls them
_FULL = 65535  # light is counted in whole numbers up to it while texels are averaged
_PNG, _INTERLACED = b"\x89PNG", 28  # how such a file begins, and its byte that is 0 where its rows follow each other
# What OpenImageIO says of an image whose header claims more than it was told to read.
_CLAIM = re.compile(r"Uncompressed image size ([\d.]+) MB exceeds .*Image claimed to be (\d+x\d+)", re.DOTALL)


class ImageError(BenchError, ValueError):
    """An image that cannot be read; the message is one sentence."""


def read_texture(source: Path | bytes, name: str, srgb: bool, raw: RawScene) -> Bytes:
    """The texels of an image file, or of such a file's bytes: uint8 (H, W, 4), row 0 on top, alpha not premultiplied.

    Greyscale becomes RGB; a missing alpha is 255. No side is longer than the raw scene's `max_texture`: of a larger
    image it is the mip level that fits, made while it is read, which is noted under this name.
    srgb: whether its colours are sRGB, so that light is averaged and not their codes. Raises ImageError where it
    cannot be read, and SceneError, before it is, where the textures do not fit into memory.
    """
    with _as_file(source) as path:
        texels, width, height = _read(path, name, srgb, raw)
    raw.take(texels.nbytes, "all its textures")
    rows, columns = texels.shape[:2]
    if (columns, rows) != (width, height):
        raw.note(f"The texture {name} of {width}x{height} is reduced to {columns}x{rows} (--max-texture).")
    return texels


@contextmanager
def _as_file(source: Path | bytes) -> Iterator[Path]:
    """An image as OpenImageIO takes it in every format: as a file, whose name is UTF-8."""
    if isinstance(source, Path) and _is_utf8(source):
        yield source
        return
    try:
        data = source.read_bytes() if isinstance(source, Path) else source
    except OSError as error:
        raise ImageError(f"the image cannot be read: {reason_of(error)}") from error
    handle, name = tempfile.mkstemp(suffix=_suffix(data))
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        yield Path(name)
    finally:
        Path(name).unlink()


def _is_utf8(path: Path) -> bool:
    """Whether a path can be written as UTF-8; others hold bytes that Python keeps as they are."""
    try:
        return bool(str(path).encode())
    except UnicodeEncodeError:
        return False


def _follows_rows(path: Path) -> bool:
    """Whether a file is decoded row by row; others may be decoded whole."""
    try:
        with path.open("rb") as file:
            head = file.read(_INTERLACED + 1)
    except OSError as error:
        raise ImageError(f"the image cannot be read: {reason_of(error)}") from error
    return head.startswith(_PNG) and head[_INTERLACED:] == b"\0"


def _read(path: Path, name: str, srgb: bool, raw: RawScene) -> tuple[Bytes, int, int]:
    """The texels, and the width and height that the image is stored with."""
    rows_follow = _follows_rows(path)
    source = _opened(path, name, raw, _LARGEST_BYTES if rows_follow else min(_LARGEST_BYTES, raw.room))
    try:
        spec = source.spec()
        width, height, stored = spec.width, spec.height, spec.image_bytes(native=True)
        if width < 1 or height < 1 or width * height > _LARGEST or stored > _LARGEST_BYTES:
            raise ImageError(_unusable(f"{width}x{height}"))
        halvings = 0
        while max(width, height) >> halvings > raw.max_texture:
            halvings += 1
        made = 4 * max(1, width >> halvings) * max(1, height >> halvings)
        raw.check(made, "all its textures", "give a smaller --max-texture")
        by_rows, channels = halvings and not spec.tile_width, min(spec.nchannels, 4)
        beside = 0 if by_rows or (not halvings and channels == 4) else width * height * channels
        raw.check(made + beside + (0 if rows_follow else stored), f"the texture {name} as it is stored")
        encoded = srgb and _is_light(source)
        if not halvings:
            return _to_rgba(_whole(source, encoded)), width, height
        whole = None if by_rows else _whole(source, encoded)

        def rows(start: int, end: int) -> Bytes:
            return _read_rows(source, start, end, encoded) if whole is None else whole[start:end]

        return _reduced(rows, width, height, halvings, srgb), width, height
    finally:
        source.close()


def _opened(path: Path, name: str, raw: RawScene, most: int) -> ImageInput:
    """The image of at most so many bytes as it is stored: some formats are decoded as they are opened.

    libpng writes what is wrong with an image to standard error before OpenImageIO says it. That stream is the whole
    process', in which a device is opened at the same time: turned away meanwhile, it would lose others' words.
    """
    import OpenImageIO

    OpenImageIO.attribute("limits:imagesize_MB", (most >> 20) + 1)  # exactly it is counted from the header
    config = OpenImageIO.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = OpenImageIO.ImageInput.open(str(path), config)
    if source is not None:
        return source
    message = OpenImageIO.geterror()
    if claim := _CLAIM.match(message):
        if (size := int(float(claim[1]) * (1 << 20))) <= _LARGEST_BYTES:
            raw.check(size, f"the texture {name} as it is stored")
        raise ImageError(_unusable(claim[2]))
    raise ImageError(f"the image cannot be read ({_reason(message)})")


def _unusable(size: str) -> str:
    most = f"{_LARGEST:,} texels and {_LARGEST_BYTES / 1e9:.1f} GB"
    return f"the image has an unusable size of {size}: at most {most} are read"


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
        raise ImageError(f"the image is damaged ({_reason(source.geterror())})")
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


def _reason(message: str) -> str:
    """The first line of what OpenImageIO says, without the file's name in quotation marks: it may be one of a copy."""
    lines = re.sub(r' \("[^"]*"\)', "", message).strip().splitlines()
    if not lines or "could not find a format reader" in lines[0]:
        return "it is of no known format"
    return re.sub(r'"[^"]*"', "it", lines[0]).rstrip(". ")
