"""Images as files have them: every kind of PNG and JPEG gives the texels that it stands for."""

import base64
import struct
import subprocess
import sys
import zlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest

from shading_atlas_bench.scenes import images
from shading_atlas_bench.scenes.images import ImageError, read_texture
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.raw import RawScene
from tests.scenes.checks import read_image
from tests.scenes.glb_files import SQUARE, Glb

TEXTURED = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
GREY, RGB, PALETTE, GREY_ALPHA, RGBA = 0, 2, 3, 4, 6  # PNG's colour types

# 8x8 texels of (200, 40, 60) in inverted CMYK, as Adobe's programs write them: compressed, in base 85.
CMYK = (
    "c-s4a<NrGbKF5^&q*R6!1`zmvo57iZmy?T|i-VV&i<^&+mtR;xR9HwzSY1X=TtQFM&_GX9SI5}O%g)%$&0I&<A>7f;$1f;2$jB}#"
    "F)ARzD=^6a{{aRO4hA4(aTa9o6=aAMWbhVb_<w{!o`Hdpl@SaWpn#EynT3^&odakkP{CFK1|~*kW+oP9R#p}kplmHro`FS>RY=j$"
    "kxe)-kzJ`!#HexNLJno8jR!@8E`CrkPAY2R<PsB?kd#tYQ`gYcGBGtXx3IKwc5!uc_we)z4hanlkBE#)PDxEm&&bRwE-5W5uc)kQ"
    "ZfR|6@96BBG<nL@Y13!SoV952lBLU*uUNTi)8;K(w{73CbJwB6M~)sle&Xb*OP8-)y>|V^&07y2J$~}^+4C1KUw!=a`ODXD-+%o4"
    "_5T(FAB!`CFGD1QHv@w`!)xu%bzyt0_W!>L00xM4X8"
)


def chunks(*parts: tuple[bytes, bytes]) -> bytes:
    """A PNG of these chunks."""
    whole = (
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in parts
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(whole)


def png_of(kind: int, depth: int, width: int, row: bytes, *more: tuple[bytes, bytes]) -> bytes:
    """A PNG of one row, with more chunks before it."""
    header = struct.pack(">IIBBBBB", width, 1, depth, kind, 0, 0, 0)
    return chunks((b"IHDR", header), *more, (b"IDAT", zlib.compress(b"\0" + row)), (b"IEND", b""))


PNGS = {
    "16 bits": (png_of(RGB, 16, 2, struct.pack(">6H", 65535, 0, 0x8080, 257, 514, 771)), [[255, 0, 128], [1, 2, 3]]),
    "palette": (png_of(PALETTE, 8, 2, b"\1\0", (b"PLTE", bytes([9, 8, 7, 200, 40, 60]))), [[200, 40, 60], [9, 8, 7]]),
    "palette with alpha": (
        png_of(PALETTE, 8, 2, b"\1\0", (b"PLTE", bytes([9, 8, 7, 200, 40, 60])), (b"tRNS", bytes([50, 255]))),
        [[200, 40, 60, 255], [9, 8, 7, 50]],
    ),
    "grey with alpha": (png_of(GREY_ALPHA, 8, 2, bytes([90, 255, 30, 128])), [[90] * 3 + [255], [30] * 3 + [128]]),
    "1 bit": (png_of(GREY, 1, 3, b"\xa0"), [[255] * 3, [0] * 3, [255] * 3]),
    "gAMA": (png_of(RGB, 8, 1, bytes([200, 40, 60]), (b"gAMA", struct.pack(">I", 100000))), [[200, 40, 60]]),
    "alpha not premultiplied": (png_of(RGBA, 8, 1, bytes([200, 40, 60, 10])), [[200, 40, 60, 10]]),
}


@pytest.mark.parametrize("name", PNGS)
def test_pngs(name):
    data, expected = PNGS[name]
    assert read_image(data)[0].tolist() == [[*texel, 255][:4] for texel in expected]


def jpeg_of(folder, texels: np.ndarray, **attributes: object) -> bytes:
    """A JPEG, written by OpenImageIO with these attributes (`_` stands for `:`)."""
    import OpenImageIO

    spec = OpenImageIO.ImageSpec(texels.shape[1], texels.shape[0], texels.shape[2], OpenImageIO.UINT8)
    for name, value in attributes.items():
        spec.attribute(name.replace("_", ":"), value)
    output = OpenImageIO.ImageOutput.create(str(folder / "a.jpg"))
    assert output
    output.open(str(folder / "a.jpg"), spec)
    output.write_image(texels)
    output.close()
    return (folder / "a.jpg").read_bytes()


def test_jpegs(tmp_path):
    """Progressive, grey, and CMYK; within what compression changes."""
    colour = np.full((16, 16, 3), (200, 40, 60), np.uint8)
    progressive = jpeg_of(tmp_path, colour, jpeg_progressive=1)
    assert b"\xff\xc2" in progressive
    assert np.abs(read_image(progressive)[..., :3].astype(int) - colour).max() <= 4
    assert np.abs(read_image(jpeg_of(tmp_path, colour[..., :1]))[..., :3].astype(int) - 200).max() <= 4
    cmyk = read_image(zlib.decompress(base64.b85decode(CMYK)))
    assert np.abs(cmyk[..., :3].astype(int) - (200, 40, 60)).max() <= 4


def light_of(file: Path, light: np.ndarray, tile: int = 0, **attributes: object) -> Path:
    """An image of fractions, written by OpenImageIO in tiles (0: rows) with these attributes (`_` stands for `:`)."""
    import OpenImageIO

    spec = OpenImageIO.ImageSpec(light.shape[1], light.shape[0], light.shape[2], OpenImageIO.FLOAT)
    for name, value in attributes.items():
        spec.attribute(name.replace("_", ":"), value)
    spec.tile_width = spec.tile_height = tile
    output = OpenImageIO.ImageOutput.create(str(file))
    assert output
    output.open(str(file), spec)
    output.write_image(light)
    output.close()
    return file


@pytest.mark.parametrize(("name", "tile"), [("a.exr", 0), ("a.exr", 16), ("a.hdr", 0)])
@pytest.mark.parametrize("most", [8192, 50])
def test_light_becomes_srgb_where_it_is_a_colour(tmp_path, name, tile, most):
    """A light of 0.214 is 127 in sRGB; of other textures it is a number as any. Rows are of several parts."""
    file = light_of(tmp_path / name, np.full((150, 100, 3), 0.214, np.float32), tile)
    raw = RawScene(max_texture=most)
    assert abs(int(read_texture(file, "a", True, raw)[..., :3].min()) - 127) <= 1
    assert np.ptp(read_texture(file, "a", True, raw)[..., :3]) == 0
    assert abs(int(read_texture(file, "a", False, raw)[..., :3].max()) - 55) <= 1


def test_light_that_no_byte_holds(tmp_path):
    light = np.array([[[np.nan, np.inf, -5, 0.5], [50, 1, 0, 0.25]]], np.float32)
    file = light_of(tmp_path / "a.exr", light, oiio_UnassociatedAlpha=1)
    texels = read_texture(file, "a", True, RawScene())
    assert texels[0, :, 3].tolist() == [128, 64]
    assert texels[0, :, :3].tolist() == [[0, 255, 0], [255, 255, 0]]


def test_the_orientation_of_a_photograph_is_ignored(tmp_path):
    """As glTF 2.0, 3.8.2 has it: texels are as stored."""
    texels = np.zeros((8, 16, 3), np.uint8)
    texels[:, :8] = 255
    data = jpeg_of(tmp_path, texels, Orientation=6)
    assert b"Exif" in data
    found = read_image(data)
    assert found.shape == (8, 16, 4)
    assert found[4, 2, 0] > 200
    assert found[4, 13, 0] < 50


def test_the_bytes_tell_the_format_not_the_mime_type(tmp_path, png):
    glb = Glb(nodes=[{"mesh": 0}], textures=[{"source": 0}])
    glb.json["images"] = [{"bufferView": glb.view(png), "mimeType": "image/jpeg"}]
    glb.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    glb.json["meshes"] = [{"primitives": [{**glb.square(TEXCOORD_0=SQUARE[:, :2]), "material": 0}]}]
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert scene.textures[0].texels.tolist() == [[[255, 0, 0, 255], [0, 0, 255, 128]]]


@pytest.mark.parametrize("extension", ["EXT_texture_webp", "MSFT_texture_dds"])
def test_textures_of_extensions_are_read_without_a_note(tmp_path, extension):
    """An image of red and half-covered green, with no other to fall back on."""
    if "dds" in extension:
        fields = struct.pack("<7I", 124, 0x100F, 1, 2, 8, 0, 0) + bytes(44)
        fields += struct.pack("<2I4s5I", 32, 0x41, bytes(4), 32, 0xFF, 0xFF00, 0xFF0000, 0xFF000000)
        data = b"DDS " + fields + struct.pack("<5I", 0x1000, 0, 0, 0, 0) + bytes([255, 0, 0, 255, 0, 255, 0, 128])
    else:
        data = base64.b64decode("UklGRiAAAABXRUJQVlA4TBMAAAAvAQAAEA8w//sfD/wPBxWI6H8AAA==")
    glb = Glb(nodes=[{"mesh": 0}], textures=[{"extensions": {extension: {"source": 0}}}])
    glb.json |= {"extensionsUsed": [extension], "extensionsRequired": [extension]}
    glb.json["images"] = [{"bufferView": glb.view(data)}]
    glb.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    glb.json["meshes"] = [{"primitives": [{**glb.square(TEXCOORD_0=SQUARE[:, :2]), "material": 0}]}]
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert scene.textures[0].texels.tolist() == [[[255, 0, 0, 255], [0, 255, 0, 128]]]
    assert not any("not supported" in note or "left out" in note for note in scene.notes)


def test_textures_that_are_too_large_are_reduced(tmp_path):
    """To their mip level that fits, of light where they are colours; a note says so."""
    from OpenImageIO import ImageOutput, ImageSpec

    texels = np.zeros((6, 8, 4), np.uint8)
    texels[::2, :, :3], texels[..., 3] = 255, np.arange(8) * 10
    output = ImageOutput.create(str(tmp_path / "a.png"))
    assert output is not None
    spec = ImageSpec(8, 6, 4, "uint8")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    output.open(str(tmp_path / "a.png"), spec)
    output.write_image(texels)
    output.close()
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd a.png\n", encoding="utf-8")
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{TEXTURED}", encoding="utf-8")
    file = str(tmp_path / "a.obj")
    whole = load_scene(file, max_texture=8)
    assert (whole.textures[0].texels == texels).all()
    assert whole.content_hash == load_scene(file).content_hash
    scene = load_scene(file, max_texture=5, cache=tmp_path / "cache")
    assert scene.textures[0].texels[..., :3].tolist() == [[[188] * 3] * 4] * 3  # half the light
    assert scene.textures[0].texels[..., 3].tolist() == [[5, 25, 45, 65]] * 3
    assert "The texture a.png of 8x6 is reduced to 4x3 (--max-texture)." in scene.notes
    assert load_scene(file, max_texture=8, cache=tmp_path / "cache").content_hash == whole.content_hash
    with pytest.raises(SceneError, match="1 texel or more, not 0"):
        load_scene(file, max_texture=0)


def test_large_images_take_no_more_memory_than_they_are_reduced_to(tmp_path):
    """A picture of 16384x16384 in 0.8 MB: 0.8 GB as it is stored, 1 GB as texels."""

    squeezed = zlib.compressobj(1)
    rows = b"".join(squeezed.compress(b"\0" + b"\x80" * (3 << 14)) for _ in range(1 << 14)) + squeezed.flush()
    header = struct.pack(">IIBBBBB", 1 << 14, 1 << 14, 8, RGB, 0, 0, 0)
    (tmp_path / "a.png").write_bytes(chunks((b"IHDR", header), (b"IDAT", rows), (b"IEND", b"")))
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd a.png\n", encoding="utf-8")
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{TEXTURED}", encoding="utf-8")
    program = (
        "import sys\n"
        "from shading_atlas_bench.harness.measure.machine import peak_memory\n"
        "from shading_atlas_bench.scenes.load import load_scene\n"
        "scene = load_scene(sys.argv[1], max_texture=1024)\n"
        "assert scene.textures[0].texels.shape == (1024, 1024, 4)\n"
        "print(peak_memory())\n"
    )
    told = subprocess.run([sys.executable, "-c", program, str(tmp_path / "a.obj")], capture_output=True, check=True)
    assert int(told.stdout) < 400 << 20


def claiming(width: int, height: int, size: int = 100_000, interlaced: bool = False) -> bytes:
    """A PNG of RGB whose header claims a width and height, in about `size` bytes."""
    header = struct.pack(">IIBBBBB", width, height, 8, RGB, 0, 0, interlaced)
    return chunks((b"IHDR", header), (b"IDAT", zlib.compress(b"") + bytes(size)), (b"IEND", b""))


def gif_claiming(width: int, height: int) -> bytes:
    head = b"GIF89a" + struct.pack("<HH", width, height) + b"\x80\0\0\0\0\0\xff\xff\xff,"
    return head + struct.pack("<HHHH", 0, 0, width, height) + b"\0\x02\x02\x44\x01\0;" + bytes(width * height // 500)


@pytest.fixture
def nothing_decoded(monkeypatch):
    """Reading a row fails the test."""
    for name in ("_whole", "_read_rows"):
        monkeypatch.setattr(images, name, lambda *_: pytest.fail("the image was read"))


@pytest.mark.usefixtures("nothing_decoded")
def test_sizes_are_counted_from_the_header_before_anything_is_read(monkeypatch):
    """On a machine of 40 MB; of 2000x2000 texels there are 16 MB as RGBA, beside 12 MB as they are read and stored."""
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(total=40_000_000))
    more = r"takes 0\.\d GB, more than half of this machine's memory, 0.0 GB: use a larger machine"
    for data, size, words in (
        (claiming(3000, 3000), 8192, "the scene, with all its textures, .*: give a smaller --max-texture"),
        (claiming(2000, 2000), 8192, f"the scene, with the texture a as it is stored, {more}"),
        (claiming(2500, 2500, interlaced=True), 1024, f"the scene, with the texture a as it is stored, {more}"),
        (gif_claiming(4000, 4000), 1, f"the scene, with the texture a as it is stored, {more}"),
    ):
        with pytest.raises(SceneError, match=words):
            read_texture(data, "a", True, RawScene(max_texture=size))


@pytest.mark.usefixtures("nothing_decoded")
def test_images_of_no_use_are_left_out_by_their_size(tmp_path):
    for size in (200_000, 20_000):
        (tmp_path / "a.png").write_bytes(claiming(size, size, 4_000_000))
        with pytest.raises(ImageError) as caught:
            read_texture(tmp_path / "a.png", "a", True, RawScene())
        most = "at most 268,435,456 texels and 2.1 GB are read"
        assert str(caught.value) == f"the image has an unusable size of {size}x{size}: {most}"


def test_a_small_image_of_rows_is_read_on_a_machine_that_could_not_hold_it_whole(monkeypatch):
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(total=10_000_000))
    rows = zlib.compress(b"".join(b"\0" + b"\x80" * 6000 for _ in range(2000)))
    header = struct.pack(">IIBBBBB", 2000, 2000, 8, RGB, 0, 0, 0)
    raw = RawScene(max_texture=1000)
    data = chunks((b"IHDR", header), (b"IDAT", rows), (b"IEND", b""))
    assert read_texture(data, "a", False, raw).tolist() == [[[128, 128, 128, 255]] * 1000] * 1000
    assert raw.taken == 4_000_000


@pytest.mark.parametrize("damage", ["cut", "header", "magic"])
def test_reasons_name_no_copy_and_end_without_a_stop(tmp_path, png, damage):
    data = {"cut": png[:50], "header": png[:20] + b"\xff" + png[21:], "magic": b"no image"}[damage]
    for source in (data, tmp_path / "a.png"):
        (tmp_path / "a.png").write_bytes(data)
        with pytest.raises(ImageError) as caught:
            read_texture(source, "a", True, RawScene())
        sentence = str(caught.value)
        assert sentence.startswith("the image ")
        assert not sentence.endswith((".", ".)"))
        assert "/" not in sentence
