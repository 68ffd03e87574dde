"""What crosses the network: H.264 and JPEG for the planes through PyAV and OpenImageIO, LZ4 for everything else."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Bytes
from shading_atlas_bench.harness.workload.settings import CODECS

if TYPE_CHECKING:
    from av import VideoFrame
    from av.video.reformatter import ColorRange, Interpolation

LARGEST_SIDE = 8192
ENCODERS_AT_A_TIME = 2
RATE = 60
JPEG_QUALITY = 85
LARGEST_LZ4_GAIN = 256  # a byte of an LZ4 block stands for at most 255
# Sides given to x264: 4:2:0 chroma needs even ones, and PyAV takes planar buffers in groups of 4 rows only.
MULTIPLE = 4

THREADS = 1  # of decoders and conversions, so that what runs beside them is not counted; changes no result
# One keyframe at the start and no other, and the same bytes on every processor: of itself x264 decides otherwise with
# AVX2 than with SSE2 or none. BT.709, limited range, is written into the stream so that any decoder knows.
X264_ALWAYS = "keyint=infinite:scenecut=0:cpu-independent=1"
X264 = f"{X264_ALWAYS}:colorprim=bt709:transfer=bt709:colormatrix=bt709:range=tv:chromaloc=1"
X264_GREY = f"{X264_ALWAYS}:range=pc"
# Flags of swscale without which results depend on the processor's SIMD, and decoded colours are 1 to 1.5 levels dark.
EXACT = ("ACCURATE_RND", "BITEXACT", "FULL_CHR_H_INT")


class CodecError(ValueError):
    """A size, a picture or a setting that a codec cannot take, or a codec that is missing; one sentence."""


class Picture:
    """One plane to encode: uint8 (H, W, 3 or 4), sRGB, alpha unused; other forms are made once, for all streams.

    A contiguous (H, W, 4) picture goes to H.264 as it is, without a copy. Raises CodecError for any other array.
    """

    def __init__(self, pixels: Array) -> None:
        if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] not in (3, 4):
            raise CodecError(
                f"A picture of {pixels.dtype} {pixels.shape} cannot be encoded: give uint8 (H, W, 3 or 4)."
            )
        self.pixels: Bytes = pixels
        self.height, self.width = pixels.shape[:2]
        self.conversion_ms = 0.0  # processor time of making `yuv`

    @cached_property
    def rgb(self) -> Bytes:
        """uint8 (H, W, 3), without alpha, contiguous."""
        return np.ascontiguousarray(self.pixels[..., :3])

    @cached_property
    def grey(self) -> Bytes:
        """Red alone, uint8 (H, W), contiguous, both sides padded to MULTIPLE by repeating the last row and column."""
        extra = [(0, _padded(self.height) - self.height), (0, _padded(self.width) - self.width)]
        return np.pad(self.pixels[..., 0], extra, "edge")

    @cached_property
    def yuv(self) -> Bytes:
        """Planar 4:2:0, uint8 (H/2*3, W), both sides padded to MULTIPLE by repeating the last row and column."""
        started = time.thread_time()
        extra = [(0, _padded(self.height) - self.height), (0, _padded(self.width) - self.width), (0, 0)]
        result = rgb_to_yuv(np.pad(self.pixels, extra, "edge") if np.any(extra) else self.pixels)
        self.conversion_ms = (time.thread_time() - started) * 1000
        return result


@dataclass(frozen=True)
class EncodedFrame:
    """One frame's bytes on the wire, what the client sees, and milliseconds of one processor core: coders use one
    thread each, so that what runs beside them is not counted.

    decoded: uint8 (H, W, 3), None unless asked.
    clocked_ms: by a clock around all that was done for the frame, preparing the picture and checks included.
    """

    bytes: int
    decoded: Bytes | None
    encode_ms: float
    decode_ms: float
    clocked_ms: float

    @property
    def shown(self) -> Bytes:
        """What the client sees, uint8 (H, W, 3). Raises CodecError for a frame of a stream that does not decode."""
        if self.decoded is None:
            raise CodecError("A frame is shown that was not decoded: open its stream with decode=True.")
        return self.decoded


class _Coder(Protocol):
    """One codec's state: encoder, and decoder where frames are wanted back."""

    def encode(self, picture: Picture) -> bytes: ...

    def decode(self, data: bytes, picture: Picture) -> Bytes: ...


class VideoStream:
    """One encoder and, if `decode`, the client's decoder behind it.

    codec: 'h264' (x264 veryfast, zerolatency, one thread, constant rate factor `crf` from 0, best, to 51), 'jpeg'
        (every frame on its own, `quality` 1..100) or 'none' (3 bytes per texel, 1 if grey, without
        loss).
    grey: pictures have one value per texel (red is taken), which is coded in full range as luma, without chroma.
    width, height: of every frame, up to 8192. H.264 needs sides that are multiples of 4: others are padded.
    The bytes of a frame depend only on the frames since the start or the last `reset`, not on the processor, so an
    interrupted run gets the same bytes by encoding its earlier frames again. Raises CodecError for what a codec cannot
    take.
    """

    def __init__(
        self,
        codec: str,
        crf: int | None,
        width: int,
        height: int,
        *,
        decode: bool = False,
        quality: int = JPEG_QUALITY,
        grey: bool = False,
    ) -> None:
        if codec not in CODECS:
            raise CodecError(f"There is no codec {codec!r}: give one of {', '.join(CODECS)}.")
        if not (1 <= width <= LARGEST_SIDE and 1 <= height <= LARGEST_SIDE):
            raise CodecError(
                f"A plane of {width}x{height} texels cannot be encoded: sides go from 1 to {LARGEST_SIDE}."
            )
        if codec == "h264" and (crf is None or not 0 <= crf <= 51):
            raise CodecError(f"The H.264 rate factor is {crf}: give a whole number from 0 to 51.")
        if codec == "jpeg" and not 1 <= quality <= 100:
            raise CodecError(f"The JPEG quality is {quality}: give a whole number from 1 to 100.")
        self.codec, self.crf, self.quality = codec, crf, quality
        self.width, self.height, self.grey = width, height, grey
        self.wants_decoded = decode
        self.reset()

    @property
    def padding(self) -> int:
        """Texels encoded beyond width * height, because H.264 gets sides that are multiples of 4."""
        return _padded(self.width) * _padded(self.height) - self.width * self.height if self.codec == "h264" else 0

    def reset(self) -> None:
        """Start again: the next frame is a keyframe and no earlier frame matters. Until it comes, this takes no memory:
        an encoder of x264 has 14 to 24 bytes for each texel."""
        self._coder: _Coder | None = None

    def _open(self) -> _Coder:
        if self.codec == "h264":
            size = (_padded(self.width), _padded(self.height))
            return _H264(self.crf, *size, self.wants_decoded, self.grey)
        return _Jpeg(self.quality, self.grey) if self.codec == "jpeg" else _Plain(self.grey)

    def encode(self, rgb: Array | Picture) -> EncodedFrame:
        """Encode the next frame, uint8 (height, width, 3 or 4), sRGB; decode it as the client would if asked to.

        Raises CodecError for a frame of another size than the stream's.
        """
        coder = self._coder = self._coder or self._open()
        began = time.thread_time()
        picture = rgb if isinstance(rgb, Picture) else Picture(rgb)
        if (picture.width, picture.height) != (self.width, self.height):
            size = f"{picture.width}x{picture.height}"
            raise CodecError(f"A frame of {size} came to a stream of {self.width}x{self.height}.")
        started = time.thread_time()
        data = coder.encode(picture)
        encoded = time.thread_time()
        decoded = coder.decode(data, picture)[: self.height, : self.width] if self.wants_decoded else None
        ended = time.thread_time()
        milliseconds = ((encoded - started) * 1000, (ended - encoded) * 1000, (ended - began) * 1000)
        return EncodedFrame(len(data), decoded, *milliseconds)


def encode_all(streams: Sequence[VideoStream], rgb: Array, *, last: bool = False) -> list[EncodedFrame]:
    """Encode one frame with every stream, two at a time (the codecs leave Python's lock); in the order of `streams`.

    rgb: uint8 (H, W, 3 or 4); a contiguous (H, W, 4) array saves a copy. last: no frame follows, so each stream is
    reset when it is done. The conversion to YUV is made once, and its
    time counted in every H.264 stream's `encode_ms`.
    """
    began = time.thread_time()
    picture = Picture(rgb)
    shared = 0.0
    if any(stream.codec == "h264" and not stream.grey for stream in streams):
        _ = picture.yuv
        shared = picture.conversion_ms
    clocked = (time.thread_time() - began) * 1000

    def encoded(stream: VideoStream) -> EncodedFrame:
        frame = stream.encode(picture)
        if last:
            stream.reset()
        return frame

    with ThreadPoolExecutor(ENCODERS_AT_A_TIME) as pool:
        frames = list(pool.map(encoded, streams))
    return [
        replace(
            f,
            encode_ms=f.encode_ms + shared * (s.codec == "h264" and not s.grey),
            clocked_ms=f.clocked_ms + clocked,
        )
        for s, f in zip(streams, frames, strict=True)
    ]


def _padded(side: int) -> int:
    return -(-side // MULTIPLE) * MULTIPLE


def _quieten_av() -> None:
    """Have PyAV print errors only. Raises CodecError where it cannot be imported."""
    try:
        from av import logging
    except ImportError as error:
        raise CodecError(f"PyAV cannot be imported ({error}): run pip install -e . again.") from error
    logging.set_level(logging.ERROR)


def rgb_to_yuv(rgb: Bytes) -> Bytes:
    """Full-range sRGB, uint8 (H, W, 3 or 4) of even size, to limited-range BT.709 4:2:0: Y, Cb, Cr, uint8 (H/2*3, W).

    Chroma is the mean of 2x2 texels, so that nothing is mixed across the even borders of an atlas's blocks. Values are
    within 0.52 of exact ones, on average within 0.01.
    """
    from av import VideoFrame
    from av.video.reformatter import ColorRange, Interpolation

    frame = VideoFrame.from_numpy_buffer(np.ascontiguousarray(rgb), "rgba" if rgb.shape[2] == 4 else "rgb24")
    return _convert(frame, "yuv420p", ColorRange.JPEG, ColorRange.MPEG, Interpolation.AREA)


def yuv_to_rgb(frame: VideoFrame) -> Bytes:
    """The inverse for a decoded frame of even size, each chroma value standing for its 2x2 texels; uint8 (H, W, 3)."""
    from av.video.reformatter import ColorRange, Interpolation

    rgb = _convert(frame, "rgb24", ColorRange.MPEG, ColorRange.JPEG, Interpolation.POINT)
    # Coding makes bluer than blue of white beside blue; from 512 levels on swscale's integers overflow and give 0.
    very_blue = _plane(frame, 1) >= 232
    if very_blue.any():
        rgb[very_blue.repeat(2, axis=0).repeat(2, axis=1) & (_plane(frame, 0) >= 216), 2] = 255  # all above 450 levels
    return rgb


def _plane(frame: VideoFrame, number: int) -> Bytes:
    """One plane of a frame, uint8 (H, W), not copied."""
    plane = frame.planes[number]
    return np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)[: plane.height, : plane.width]


def _convert(frame: VideoFrame, to: str, from_range: ColorRange, to_range: ColorRange, chroma: Interpolation) -> Bytes:
    """The frame in the format `to`, both in BT.709; `chroma`: how its samples are thinned out or repeated."""
    from av.video.reformatter import Colorspace, Interpolation, VideoReformatter

    for name in EXACT:
        chroma |= Interpolation[name]
    converted = VideoReformatter().reformat(
        frame,
        format=to,
        src_colorspace=Colorspace.ITU709,
        dst_colorspace=Colorspace.ITU709,
        src_color_range=from_range,
        dst_color_range=to_range,
        interpolation=chroma,
        threads=THREADS,
    )
    return np.asarray(converted.to_ndarray(), np.uint8)


def as_grey(values: Bytes) -> Bytes:
    """uint8 (H, W, 3) of one value per texel, (H, W)."""
    return np.repeat(values[..., None], 3, axis=2)


class _H264:
    """x264 through PyAV, and FFmpeg's decoder behind it; `width` and `height` are multiples of 4."""

    def __init__(self, crf: int | None, width: int, height: int, decode: bool, grey: bool) -> None:
        _quieten_av()
        from av import CodecContext
        from av.video.reformatter import ColorRange

        self.grey, self.range = grey, ColorRange.JPEG if grey else ColorRange.MPEG
        self.encoder = CodecContext.create("libx264", "w")
        self.encoder.width, self.encoder.height = width, height
        self.encoder.pix_fmt = "gray" if grey else "yuv420p"
        self.encoder.time_base, self.encoder.framerate = Fraction(1, RATE), Fraction(RATE)
        # More threads change the bitstream.
        self.encoder.thread_count = 1
        self.encoder.color_range = self.range
        params = X264_GREY if grey else X264
        self.encoder.options = {"preset": "veryfast", "tune": "zerolatency", "crf": str(crf), "x264-params": params}
        self.encoder.open()
        self.decoder = CodecContext.create("h264", "r") if decode else None
        if self.decoder is not None:
            self.decoder.thread_count = THREADS
        self.count = 0

    def encode(self, picture: Picture) -> bytes:
        from av import VideoFrame
        from av.video.reformatter import Colorspace

        pixels = (picture.grey, "gray") if self.grey else (picture.yuv, "yuv420p")
        frame = VideoFrame.from_numpy_buffer(*pixels)
        frame.pts, frame.time_base = self.count, Fraction(1, RATE)
        frame.colorspace, frame.color_range = Colorspace.ITU709, self.range
        self.count += 1
        packets = self.encoder.encode(frame)
        if len(packets) != 1:
            raise CodecError(f"x264 gave {len(packets)} packets for one frame: this build delays frames.")
        return bytes(packets[0])

    def decode(self, data: bytes, picture: Picture) -> Bytes:
        from av import Packet

        if self.decoder is None:
            raise CodecError("A stream without a decoder cannot decode: open it with decode=True.")
        frames = self.decoder.decode(Packet(data))
        if len(frames) != 1:
            raise CodecError(f"The H.264 decoder gave {len(frames)} frames for one packet: this build delays frames.")
        (frame,) = frames
        if self.grey:
            return as_grey(np.asarray(frame.to_ndarray(), np.uint8)[: frame.height, : frame.width])
        return yuv_to_rgb(frame)


class _Jpeg:
    """Baseline JPEG with 4:2:0 chroma through OpenImageIO, whose Python writes to files only."""

    def __init__(self, quality: int, grey: bool) -> None:
        self.quality, self.grey = quality, grey

    def encode(self, picture: Picture) -> bytes:
        import OpenImageIO

        pixels = np.ascontiguousarray(picture.pixels[..., :1]) if self.grey else picture.rgb
        spec = OpenImageIO.ImageSpec(picture.width, picture.height, pixels.shape[2], "uint8")
        spec.attribute("Compression", f"jpeg:{self.quality}")
        spec.attribute("jpeg:subsampling", "4:2:0")
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "frame.jpg"
            output = OpenImageIO.ImageOutput.create(str(file))
            if output is None or not (output.open(str(file), spec) and output.write_image(pixels)):
                size = f"{picture.width}x{picture.height}"
                raise CodecError(f"OpenImageIO cannot write a JPEG of {size}: {OpenImageIO.geterror()}")
            output.close()
            return file.read_bytes()

    def decode(self, data: bytes, picture: Picture) -> Bytes:
        import OpenImageIO

        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "frame.jpg"
            file.write_bytes(data)
            source = OpenImageIO.ImageInput.open(str(file))
            pixels = source.read_image(format="uint8") if source else None
            if source is None or pixels is None:
                raise CodecError(f"OpenImageIO cannot read back its own JPEG: {OpenImageIO.geterror()}")
            source.close()
            return as_grey(pixels[..., 0]) if self.grey else pixels


class _Plain:
    """No codec: 3 bytes per texel, 1 if grey."""

    def __init__(self, grey: bool) -> None:
        self.grey = grey

    def encode(self, picture: Picture) -> bytes:
        return picture.pixels[..., 0].tobytes() if self.grey else picture.rgb.tobytes()

    def decode(self, data: bytes, picture: Picture) -> Bytes:
        return as_grey(picture.pixels[..., 0]) if self.grey else picture.rgb


def pack_lz4(blobs: Mapping[str, bytes]) -> dict[str, bytes]:
    """Each blob as one LZ4 block with its length in front; the same bytes every time."""
    import lz4.block

    return {name: lz4.block.compress(data, store_size=True) for name, data in blobs.items()}


def unpack_lz4(packed: Mapping[str, bytes]) -> dict[str, bytes]:
    """The inverse of `pack_lz4`. Raises CodecError, naming the blob, if one is damaged or claims to be larger than its
    bytes can hold; then nothing of that size is allocated."""
    import lz4.block

    blobs = {}
    for name, data in packed.items():
        if int.from_bytes(data[:4], "little") > LARGEST_LZ4_GAIN * len(data):
            raise CodecError(
                f"The LZ4 block {name!r} is damaged: its {len(data)} bytes cannot hold what they claim to."
            )
        try:
            blobs[name] = lz4.block.decompress(data)
        except (lz4.block.LZ4BlockError, ValueError) as error:
            raise CodecError(f"The LZ4 block {name!r} is damaged: {error}") from error
    return blobs
