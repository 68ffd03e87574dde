"""Images through OpenImageIO, from files and from bytes inside other files."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes
from shading_atlas_bench.scenes.files import is_utf8

_LARGEST = 1 << 28  # texels; anything above is a damaged header, not a texture


def read_image(path: Path) -> Bytes:
    """The texels of an image file: uint8 (H, W, 4), row 0 on top, alpha not premultiplied.

    Greyscale becomes RGB; a missing alpha is 255. Raises ValueError with one sentence where it cannot be read.
    """
    import OpenImageIO

    if not is_utf8(path):  # OpenImageIO takes no other names
        return decode_image(path.read_bytes())
    config = OpenImageIO.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = OpenImageIO.ImageInput.open(str(path), config)
    if source is None:
        raise ValueError(f"the image cannot be read ({_first_line(OpenImageIO.geterror())})")
    try:
        spec = source.spec()
        if spec.width < 1 or spec.height < 1 or spec.width * spec.height > _LARGEST:
            raise ValueError(f"the image has an unusable size of {spec.width}x{spec.height}")
        channels = min(spec.nchannels, 4)
        texels = source.read_image(0, 0, 0, channels, OpenImageIO.UINT8)
        if texels is None:
            raise ValueError(f"the image is damaged ({_first_line(source.geterror())})")
        return _to_rgba(np.asarray(texels).reshape(spec.height, spec.width, channels))
    finally:
        source.close()


def decode_image(data: bytes) -> Bytes:
    """As `read_image`, from an image file's bytes (OpenImageIO reads files only, so through a temporary one)."""
    handle, name = tempfile.mkstemp(suffix=_suffix(data))
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        return read_image(Path(name))
    finally:
        Path(name).unlink()


def _to_rgba(texels: Bytes) -> Bytes:
    channels = texels.shape[2]
    rgba = np.full((*texels.shape[:2], 4), 255, np.uint8)
    rgba[..., :3] = texels[..., :3] if channels >= 3 else texels[..., :1]
    if channels in (2, 4):
        rgba[..., 3] = texels[..., channels - 1]
    return rgba


def _suffix(data: bytes) -> str:
    known = {b"\x89PNG": ".png", b"\xff\xd8": ".jpg", b"RIFF": ".webp", b"DDS ": ".dds", b"BM": ".bmp", b"GIF8": ".gif"}
    return next((suffix for magic, suffix in known.items() if data.startswith(magic)), ".image")


def _first_line(message: str) -> str:
    return message.strip().splitlines()[0] if message.strip() else "unknown format"
