"""Codecs: colours survive, bytes are deterministic and real, sizes that codecs dislike, LZ4 there and back."""

import itertools
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.harness.measure.codecs import (
    CodecError,
    Picture,
    VideoStream,
    encode_all,
    pack_lz4,
    unpack_lz4,
    yuv_to_rgb,
)

PATCHES = np.array(
    [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0], [0, 255, 255], [255, 0, 255], [255] * 3, [0] * 3], np.uint8
)


def chart(height=128, width=256):
    """A grey ramp above saturated patches."""
    image = np.empty((height, width, 3), np.uint8)
    image[: height // 2] = (np.arange(width) * 255 // (width - 1))[None, :, None]
    image[height // 2 :] = PATCHES.repeat(width // 8, axis=0)[None]
    return image


def moving(frames=4, height=96, width=128, seed=0):
    """A few frames of a moving texture."""
    rng = np.random.default_rng(seed)
    texture = rng.integers(0, 256, (height // 8, width // 8, 3)).repeat(8, axis=0).repeat(8, axis=1).astype(np.uint8)
    return [np.roll(texture, k, axis=1) for k in range(frames)]


@pytest.mark.parametrize("crf", [0, 5])
def test_colours_survive_h264(crf):
    image = chart()
    decoded = VideoStream("h264", crf, 256, 128, decode=True).encode(image).decoded
    assert decoded is not None
    assert decoded.shape == image.shape
    error = np.abs(decoded.astype(int) - image)
    assert error[:60].max() <= 3
    assert error[70:, 16::32].max() <= 4
    assert abs(error.mean()) < 1


@pytest.mark.parametrize(("codec", "most"), [("h264", 4), ("jpeg", 20), ("none", 0)])
def test_a_grey_plane_survives_in_full_range(codec, most):
    """Of a size that needs padding; only red counts, and no chroma is sent."""
    rng = np.random.default_rng(1)
    values = np.repeat(np.linspace(0, 255, 121).astype(np.uint8)[None], 70, axis=0)
    values[30:50], values[50:] = 255, 0
    image = np.dstack([values, rng.integers(0, 256, (70, 121, 3)).astype(np.uint8)])
    stream = VideoStream(codec, 5 if codec == "h264" else None, 121, 70, decode=True, grey=True)
    frames = [stream.encode(image) for _ in range(2)]
    for frame in frames:
        assert frame.decoded is not None
        assert frame.decoded.shape == (70, 121, 3)
        assert np.abs(frame.decoded.astype(int) - values[..., None]).max() <= most
        assert (frame.decoded[34:46] == 255).all()
        assert (frame.decoded[58:] == 0).all()
    assert frames[0].bytes == 70 * 121 if codec == "none" else frames[0].bytes < 3000


def smooth_colours(height, width, seed=0):
    """Every colour somewhere: each channel a sum of long random waves, stretched to 0..255."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width][..., None] / 50
    waves = sum(np.sin(x * rng.uniform(-1, 1, 3) + y * rng.uniform(-1, 1, 3) + rng.uniform(0, 6, 3)) for _ in range(6))
    waves -= waves.min(axis=(0, 1))
    return np.rint(waves / np.maximum(waves.max(axis=(0, 1)), 1e-9) * 255).astype(np.uint8)


def bt709_twin(rgb):
    """Limited-range BT.709 of full-range RGB (H, W, 3), float64: Y (H, W), the means of Cb and Cr over 2x2."""
    luma = rgb @ [0.2126, 0.7152, 0.0722]
    half = (rgb.shape[0] // 2, 2, rgb.shape[1] // 2, 2)
    cb, cr = (
        ((rgb[..., channel] - luma) / scale).reshape(half).mean(axis=(1, 3))
        for channel, scale in ((2, 1.8556), (0, 1.5748))
    )
    return 16 + 219 / 255 * luma, 128 + 224 / 255 * cb, 128 + 224 / 255 * cr


def rgb_twin(y, cb, cr):
    """The inverse, float64 (H, W, 3), within 0..255: each chroma value stands for 2x2 texels."""
    luma = (y - 16.0) * 255 / 219
    cb, cr = (
        ((plane - 128.0) * 255 / 224).repeat(2, axis=0).repeat(2, axis=1)[: len(y), : y.shape[1]] for plane in (cb, cr)
    )
    red, blue = luma + 1.5748 * cr, luma + 1.8556 * cb
    return np.clip(np.stack([red, (luma - 0.2126 * red - 0.0722 * blue) / 0.7152, blue], axis=-1), 0, 255)


CONVERSION_ERROR = 0.52  # levels; 0.5 is the rounding


@pytest.mark.parametrize("size", [(540, 960), (67, 121), (1, 1), (201, 334), (2, 4099)])
@pytest.mark.parametrize("channels", [3, 4])
def test_colours_become_limited_range_bt709(size, channels):
    """Odd sizes are padded by their last row and column, so that border chroma is not mixed with anything else."""
    pixels = np.dstack([smooth_colours(*size), np.zeros(size, np.uint8)])[..., :channels]
    got = Picture(pixels).yuv
    height, width = (-(-side // 4) * 4 for side in size)
    padded = np.pad(pixels[..., :3], [(0, height - size[0]), (0, width - size[1]), (0, 0)], "edge")
    chroma = got[height:].reshape(2, height // 2, width // 2)
    for plane, exact in zip((got[:height], *chroma), bt709_twin(padded), strict=True):
        assert np.abs(plane - exact).max() <= CONVERSION_ERROR
        if plane.size > 10_000:
            assert abs((plane - exact).mean()) <= 0.01


def frame_of(*planes):
    """A yuv420p frame of these planes, uint8."""
    import av

    height, width = planes[0].shape
    frame = av.VideoFrame(width, height, "yuv420p")
    for plane, values in zip(frame.planes, planes, strict=True):
        padded = np.zeros((plane.height, plane.line_size), np.uint8)
        padded[:, : plane.width] = values
        plane.update(padded.tobytes())
    return frame


@pytest.mark.parametrize("size", [(540, 960), (2, 2), (202, 334), (16, 4100), (66, 122)])
def test_limited_range_bt709_becomes_colours(size):
    rng = np.random.default_rng(3)
    planes = [rng.integers(16, 241, (size[0] // n, size[1] // n), dtype=np.uint8) for n in (1, 2, 2)]
    error = yuv_to_rgb(frame_of(*planes)) - rgb_twin(*planes)
    assert error.shape == (*size, 3)
    assert np.abs(error).max() <= CONVERSION_ERROR
    if error.size > 100_000:
        assert np.abs(error.mean(axis=(0, 1))).max() <= 0.01


@pytest.mark.parametrize("cr", [0, 16, 128, 240, 255])
def test_no_decoded_value_overflows(cr):
    """All values of Y and Cb: coding makes more of them than colours have (white beside blue at a low rate)."""
    y, cb = np.mgrid[:256, :256].astype(np.uint8)
    planes = (y.repeat(2, axis=0).repeat(2, axis=1), cb, np.full_like(cb, cr))
    assert np.abs(yuv_to_rgb(frame_of(*planes)) - rgb_twin(*planes)).max() <= CONVERSION_ERROR


# Codec, rate factor or quality, grey, largest error in levels: almost lossless, so that a bias of conversions shows.
ALMOST_LOSSLESS = [("h264", 0, False, 9), ("h264", 0, True, 0), ("jpeg", 100, False, 9), ("jpeg", 100, True, 2)]


@pytest.mark.parametrize(("codec", "rate", "grey", "most"), ALMOST_LOSSLESS)
@pytest.mark.parametrize("size", [(540, 960), (203, 333)])
def test_there_and_back_no_colour_drifts(codec, rate, grey, most, size):
    image = smooth_colours(*size)
    rates = {"crf": rate} if codec == "h264" else {"crf": None, "quality": rate}
    decoded = VideoStream(codec, width=size[1], height=size[0], decode=True, grey=grey, **rates).encode(image).decoded
    error = decoded - image[..., :1].astype(float) if grey else decoded - image.astype(float)
    assert np.abs(error.mean(axis=(0, 1))).max() <= 0.05
    assert np.abs(error).max() <= most


def test_the_stream_says_what_its_colours_are():
    import av

    stream = VideoStream("h264", 20, 64, 64)
    data = stream._open().encode(Picture(chart(64, 64)))
    frame = av.CodecContext.create("h264", "r").decode(av.Packet(data))[0]
    assert (int(frame.colorspace), int(frame.color_range), int(frame.color_primaries), int(frame.color_trc)) == (1,) * 4


def test_after_the_last_frame_streams_hold_nothing():
    streams = [VideoStream("h264", crf, 128, 96, decode=True) for crf in (10, 30)]
    frames = moving(2)
    first, second = encode_all(streams, frames[0]), encode_all(streams, frames[1], last=True)
    assert all(stream._coder is None for stream in streams)
    kept = [VideoStream("h264", crf, 128, 96, decode=True) for crf in (10, 30)]
    again = [encode_all(kept, frame) for frame in frames]
    assert [[one.bytes for one in every] for every in (first, second)] == [
        [one.bytes for one in every] for every in again
    ]


@pytest.mark.parametrize("codec", ["h264", "jpeg"])
def test_same_frames_give_the_same_bytes(codec):
    frames = moving()

    def sizes(stream):
        return [stream.encode(frame).bytes for frame in frames]

    stream = VideoStream(codec, 25, 128, 96)
    first = sizes(stream)
    assert all(size > 0 for size in first)
    stream.reset()
    assert sizes(stream) == first
    assert sizes(VideoStream(codec, 25, 128, 96, decode=True)) == first


def test_only_the_first_frame_is_a_keyframe():
    stream = VideoStream("h264", 25, 128, 96)
    still = moving(1)[0]
    first, *later = (stream.encode(still).bytes for _ in range(20))
    assert max(later) < first / 5
    stream.encode(255 - still)
    assert stream.encode(255 - still).bytes < first / 5


def test_a_higher_rate_factor_gives_fewer_bytes_and_worse_pictures():
    frame = np.random.default_rng(0).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    coded = [VideoStream("h264", crf, 64, 64, decode=True).encode(frame) for crf in (5, 25, 45)]
    errors = [np.abs(c.decoded.astype(int) - frame).mean() for c in coded if c.decoded is not None]
    assert len(errors) == 3
    assert coded[0].bytes > coded[1].bytes > coded[2].bytes
    assert errors == sorted(errors)


@pytest.mark.parametrize("size", [(1, 1), (2, 2), (17, 33), (201, 333), (16, 4100), (8192, 18)])
@pytest.mark.parametrize("codec", ["h264", "jpeg", "none"])
def test_sizes(codec, size):
    height, width = size
    image = np.full((height, width, 3), (200, 100, 50), np.uint8)
    stream = VideoStream(codec, 10, width, height, decode=True)
    frame = stream.encode(image)
    assert frame.decoded is not None
    assert frame.decoded.shape == image.shape
    assert np.abs(frame.decoded.astype(int) - image).max() <= 4
    padded = (-(-width // 4) * 4) * (-(-height // 4) * 4) - width * height
    assert stream.padding == (padded if codec == "h264" else 0)


def test_no_codec_counts_three_bytes_per_texel_and_loses_nothing():
    frame = moving(1)[0]
    coded = VideoStream("none", None, 128, 96, decode=True).encode(frame)
    assert coded.bytes == 3 * 128 * 96
    np.testing.assert_array_equal(coded.decoded, frame)


def test_jpeg_quality_costs_bytes():
    frame = moving(1)[0]
    sizes = [VideoStream("jpeg", None, 128, 96, quality=q).encode(frame).bytes for q in (30, 85, 98)]
    assert sizes == sorted(sizes)


def test_several_streams_at_once_give_what_each_gives_alone():
    frames = moving(5)
    settings_ = [
        ("h264", 5, False),
        ("h264", 25, True),
        ("h264", 35, False),
        ("jpeg", None, True),
        ("none", None, True),
    ]

    def open_all():
        return [VideoStream(codec, crf, 128, 96, decode=decode) for codec, crf, decode in settings_]

    together, alone = open_all(), open_all()
    for frame in frames:
        for got, stream in zip(encode_all(together, frame), alone, strict=True):
            expected = stream.encode(frame)
            assert got.bytes == expected.bytes
            assert (got.decoded is None) == (expected.decoded is None)
            if got.decoded is not None:
                np.testing.assert_array_equal(got.decoded, expected.decoded)


@pytest.fixture
def doubling_clock(monkeypatch):
    """The processor's clock, which goes on by 1 s, then 2, 4, 8 ... before each reading."""
    readings = itertools.accumulate(1 << step for step in itertools.count())
    monkeypatch.setattr(time, "thread_time", lambda: float(next(readings)))


def test_coding_takes_what_the_clock_says(doubling_clock):
    """Read at the beginning, before coding, before decoding (4 s later) and behind it (8 s later)."""
    frame = VideoStream("none", None, 128, 96, decode=True).encode(moving(1)[0])
    assert (frame.encode_ms, frame.decode_ms, frame.clocked_ms) == (4000, 8000, 2000 + 4000 + 8000)


def test_a_conversion_for_all_streams_is_counted_in_each(doubling_clock):
    """Read at the beginning, around the conversion (4 s), behind it (8 s), and by the stream (first 16 s)."""
    (frame,) = encode_all([VideoStream("h264", 25, 128, 96)], moving(1)[0])
    assert (frame.encode_ms, frame.decode_ms) == (4000 + 64_000, 128_000)
    assert frame.clocked_ms == 2000 + 4000 + 8000 + 32_000 + 64_000 + 128_000


def test_what_needs_no_conversion_counts_none(doubling_clock):
    (frame,) = encode_all([VideoStream("h264", 25, 128, 96, grey=True)], moving(1)[0])
    assert (frame.encode_ms, frame.decode_ms) == (16_000, 32_000)
    assert frame.clocked_ms == 2000 + 8000 + 16_000 + 32_000


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("vp8", 10, 64, 64), "h264, jpeg, none"),
        (("h264", 52, 64, 64), "0 to 51"),
        (("h264", None, 64, 64), "0 to 51"),
        (("h264", 10, 8193, 64), "8192"),
        (("jpeg", None, 0, 64), "1 to 8192"),
    ],
)
def test_settings_a_codec_cannot_take_are_refused(arguments, words):
    with pytest.raises(CodecError, match=words):
        VideoStream(*arguments)


def test_frames_that_do_not_fit_are_refused():
    stream = VideoStream("h264", 10, 64, 64)
    with pytest.raises(CodecError, match="32x64"):
        stream.encode(np.zeros((64, 32, 3), np.uint8))
    with pytest.raises(CodecError, match="uint8"):
        stream.encode(np.zeros((64, 64, 4), np.float32))


@pytest.mark.parametrize("codec", ["h264", "jpeg", "none"])
def test_alpha_changes_nothing(codec):
    frame = moving(1, height=90)[0]
    alpha = np.random.default_rng(0).integers(0, 256, (*frame.shape[:2], 1)).astype(np.uint8)
    plain, with_alpha = (
        VideoStream(codec, 25, *frame.shape[1::-1], decode=True).encode(pixels)
        for pixels in (frame, np.concatenate([frame, alpha], axis=2))
    )
    assert plain.bytes == with_alpha.bytes
    np.testing.assert_array_equal(plain.decoded, with_alpha.decoded)


@settings(max_examples=20, deadline=None)
@given(st.dictionaries(st.text(max_size=5), st.binary(max_size=2000), max_size=4))
def test_lz4_there_and_back(blobs):
    packed = pack_lz4(blobs)
    assert unpack_lz4(packed) == blobs
    assert pack_lz4(blobs) == packed


def test_lz4_compresses_and_names_a_damaged_block():
    packed = pack_lz4({"words": b"atlas " * 1000})
    assert len(packed["words"]) < 200
    for damaged in (packed["words"][:20], packed["words"][:3], b""):
        with pytest.raises(CodecError, match="words"):
            unpack_lz4({"words": damaged})


@pytest.mark.parametrize("claim", [1 << 20, (1 << 31) - 1, (1 << 32) - 1])
def test_lz4_that_claims_too_much_is_refused_before_it_is_unpacked(claim):
    packed = pack_lz4({"lists": bytes(1000)})["lists"]
    with pytest.raises(CodecError, match="cannot hold"):
        unpack_lz4({"lists": claim.to_bytes(4, "little") + packed[4:]})
    assert unpack_lz4(pack_lz4({"zeros": bytes(10_000_000), "none": b""})) == {"zeros": bytes(10_000_000), "none": b""}
