"""Fixtures for loading scenes."""

import struct
import zlib

import pytest


@pytest.fixture(scope="session")
def png() -> bytes:
    """A PNG of 2x1 texels: opaque red, and blue at half coverage."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 2, 1, 8, 6, 0, 0, 0)
    rows = b"\0" + bytes([255, 0, 0, 255, 0, 0, 255, 128])
    parts = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts
