"""Geometry messages: what was encoded is what the client has, and nothing is sent twice."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.kernels.triangles import Triangles
from shading_atlas_bench.packers.geometry import GeometryDecoder, GeometryEncoder, shuffle, unshuffle


@given(values=st.lists(st.integers(-(2**31), 2**31 - 1), max_size=40))
def test_unshuffle_inverts_shuffle(values):
    array = np.array(values, np.int32)
    data = b"ab" + shuffle(array)
    np.testing.assert_array_equal(unshuffle(data, np.int32, len(values), 2), array)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 120))
def test_the_client_has_every_set_in_full(seed, count):
    rng = np.random.default_rng(seed)
    positions, uvs = rng.normal(size=(3 * count, 3)).astype(np.float32), rng.random((3 * count, 2), np.float32)
    indices = rng.integers(0, 3 * count, (count, 3)).astype(np.int32)
    flags, materials = rng.integers(0, 16, count).astype(np.uint8), rng.integers(0, 300, count)
    opacities = rng.integers(0, 257, 300).astype(np.uint16)
    patch = rng.integers(0, 1 << 20, count).astype(np.int32)
    alphas = rng.random(3 * count, np.float32)
    encoder = GeometryEncoder(positions, indices, flags, uvs, materials, {"patch": patch}, opacities, alphas)
    decoder = GeometryDecoder({"patch": np.int32})
    sent = 0
    for share in (0.3, 0.3, 0, 1, 0.7, 1):
        pvs = np.flatnonzero(rng.random(count) < share).astype(np.int32)
        message = encoder.encode(pvs)
        decoder.decode(message)
        sent += len(message)
        np.testing.assert_array_equal(decoder.pvs, pvs)
        np.testing.assert_array_equal(decoder.current("positions"), positions[indices[pvs]].reshape(-1, 9))
        np.testing.assert_array_equal(decoder.current("flags"), flags[pvs])
        np.testing.assert_array_equal(decoder.current("patch"), patch[pvs])
        masked = (flags[pvs] & Triangles.MASKED) > 0
        np.testing.assert_array_equal(decoder.current("uvs")[masked], uvs[indices[pvs[masked]]].reshape(-1, 6))
        faded = (flags[pvs] & Triangles.FADED) > 0
        np.testing.assert_array_equal(decoder.current("alphas")[faded], alphas[indices[pvs[faded]]])
        special, blended = (
            (flags[pvs] & bits) > 0 for bits in (Triangles.MASKED | Triangles.BLENDED, Triangles.BLENDED)
        )
        np.testing.assert_array_equal(decoder.current("materials")[special], materials[pvs[special]])
        expected = np.where(blended, opacities[materials[pvs]], 255)
        np.testing.assert_array_equal(decoder.current_opacities(), expected)
    assert sent <= count * (36 + 1 + 26 + 12 + 4 + 4) + 6 * (4 + 4 * count + 2)


def test_without_blended_triangles_nothing_is_sent_for_them():
    rng = np.random.default_rng(0)
    positions, indices = rng.normal(size=(30, 3)).astype(np.float32), np.arange(30, dtype=np.int32).reshape(10, 3)
    flags, uvs = rng.integers(0, 4, 10).astype(np.uint8), rng.random((30, 2), np.float32)
    everything = np.arange(10, dtype=np.int32)
    messages = [
        GeometryEncoder(positions, indices, flags, uvs, np.zeros(10, int), {}, opacities).encode(everything)
        for opacities in (None, np.full(1, 100, np.uint16))
    ]
    assert messages[0] == messages[1]
    assert len(messages[0]) == 4 + 40 + 360 + 10 + 26 * np.count_nonzero(flags & Triangles.MASKED)


def test_an_unchanged_set_costs_a_count():
    encoder = GeometryEncoder(
        np.zeros((3, 3), np.float32),
        np.array([[0, 1, 2]], np.int32),
        np.zeros(1, np.uint8),
        np.zeros((3, 2), np.float32),
        np.zeros(1, np.int32),
        {},
    )
    encoder.encode(np.zeros(1, np.int32))
    assert encoder.encode(np.zeros(1, np.int32)) == b"\0\0\0\0"


def test_how_much_a_material_covers_is_said_once():
    corner = np.zeros((3, 3), np.float32)
    flags, materials = np.full(3, Triangles.BLENDED, np.uint8), np.array([7, 7, 8])
    known = (corner, np.zeros((3, 3), np.int32), flags, np.zeros((3, 2), np.float32), materials)
    encoder = GeometryEncoder(*known, {}, np.arange(9, dtype=np.uint16))
    changed, new, materials_of_new, opacity = 4, 4 + 36 + 1 + 2, 2, 4  # bytes
    sizes = [len(encoder.encode(np.arange(count, dtype=np.int32))) for count in (1, 2, 3)]
    assert sizes == [changed + new + materials_of_new + count * opacity for count in (1, 0, 1)]
