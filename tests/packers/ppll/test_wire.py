"""The wire format: what was sent arrives, in both layouts, and nothing else is accepted."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.packers.ppll import wire
from shading_atlas_bench.packers.ppll.kernels.wire import LAYOUTS, write_twin
from shading_atlas_bench.packers.ppll.wire import MODES, Head, Message, WireError, decode


def encode(*views: Message) -> tuple[bytes, bytes]:
    """The heads and the lists."""
    lists = b"".join(write_twin(*node, view.layout) for view in views for node in view.nodes)
    return wire.encode(views, lists), lists


def message(seed=0, layout="paper", words=2, nodes=1, pixels=(9, 7), most=5) -> Message:
    mode = MODES[seed % 3] if words == 2 else "bilateral"
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(nodes):
        counts = rng.integers(0, most + 1, pixels[0] * pixels[1]) * (rng.random(pixels[0] * pixels[1]) < 0.6)
        rows = rng.integers(0, 2**32, (int(counts.sum()), words), dtype=np.uint64).astype(np.uint32)
        real = rng.uniform(0, 10, (len(rows), 1 if words == 2 else 3)).astype(np.float32)
        rows[:, -real.shape[1] :] = real.view(np.uint32)
        parts.append((np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), rows))
    return Message(
        mode=mode,
        layout=layout,
        width=pixels[0],
        height=pixels[1],
        view=rng.normal(size=(4, 4)),
        projection=rng.normal(size=(4, 4)),
        words=words,
        counts=tuple(len(rows) for _, rows in parts),
        merge="paper",
        threshold=0.25,
        nodes=tuple(parts),
    )


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 1000),
    layout=st.sampled_from(LAYOUTS),
    words=st.sampled_from([2, 5]),
    nodes=st.integers(1, 3),
    most=st.integers(0, 40),
)
def test_what_was_sent_arrives(seed, layout, words, nodes, most):
    sent = message(seed, layout, words, nodes, most=most)
    head, lists = encode(sent)
    assert len(lists) == sent.raw_bytes  # before LZ4 both layouts are as long as the thesis' structures
    (got,) = decode(head, lists)
    assert (got.mode, got.layout, got.width, got.height) == (sent.mode, layout, sent.width, sent.height)
    assert (got.merge, got.threshold) == ("paper", 0.25)
    np.testing.assert_array_equal(got.view, sent.view)
    np.testing.assert_array_equal(got.projection, sent.projection)
    for (offsets, rows), (expected_offsets, expected_rows) in zip(got.nodes, sent.nodes, strict=True):
        np.testing.assert_array_equal(offsets, expected_offsets)
        np.testing.assert_array_equal(rows, expected_rows)


def several(count: int, layout: str = "paper", words: int = 2, nodes: int = 2) -> list[Message]:
    """Messages of views of different sizes in one mode."""
    views = [message(number, layout, words, nodes, pixels=(9 - number, 5 + number)) for number in range(count)]
    return [replace(view, mode=views[0].mode) for view in views]


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("words", [2, 5])
def test_lists_of_several_views_arrive_view_by_view(layout, words):
    sent = several(4, layout, words)
    head, lists = encode(*sent)
    assert head == b"".join(encode(view)[0] for view in sent)
    assert len(lists) == sum(view.raw_bytes for view in sent)
    for got, view in zip(decode(head, lists), sent, strict=True):
        assert (got.width, got.height, got.counts) == (view.width, view.height, view.counts)
        np.testing.assert_array_equal(got.projection, view.projection)
        for one, expected in zip(got.nodes, view.nodes, strict=True):
            assert [array.tobytes() for array in one] == [array.tobytes() for array in expected]


def test_heads_of_several_views_must_fit_their_lists_and_each_other():
    views = several(3)
    head, lists = encode(*views)
    size = len(head) // 3
    heads = [head[at : at + size] for at in range(0, len(head), size)]
    assert not refused(b"".join(heads), lists)
    assert refused(b"".join(heads[:2]), lists)  # a view less
    assert refused(b"".join([*heads, heads[0]]), lists)  # a view more
    assert refused(b"".join([heads[1], heads[0], heads[2]]), lists)  # the lists of another view
    for changes in ({"mode": "difference"}, {"layout": "shuffled"}, {"merge": "exact"}, {"threshold": 0.5}):
        assert refused(*encode(views[0], replace(views[1], **changes), views[2]))
    fewer = replace(views[2], nodes=views[2].nodes[:1], counts=views[2].counts[:1])
    assert refused(*encode(views[0], views[1], fewer))


def test_all_views_together_are_no_larger_than_one_may_be():
    head, lists = encode(*several(2, nodes=1))
    size = np.array([wire.LARGEST_SIDE] * 2, "<u4").tobytes()
    half = len(head) // 2
    huge = head[:16] + size + head[24 : half + 16] + size + head[half + 24 :]
    with pytest.raises(WireError, match="more pixels"):
        decode(huge, lists)


def test_sizes_are_those_of_the_thesis():
    """Equations 3.3 and 3.4, tables 2.1 and 2.2."""
    empty, full = message(most=0, pixels=(1280, 720)), message(pixels=(1920, 1080), most=0)
    assert empty.raw_bytes == 3600 * 1024
    assert full.raw_bytes == 8100 * 1024
    size: dict[str, Any] = {"width": 1280, "height": 720, "view": np.eye(4), "projection": np.eye(4)}
    for words, plain, padded in ((2, 10800, 14400), (5, 21600, 28800)):
        one = Head(mode="full", layout="paper", words=words, counts=(1280 * 720,), **size)
        assert one.raw_bytes == (3600 + plain) * 1024
        assert one.padded_bytes == (3600 + padded) * 1024


def refused(head: bytes, lists: bytes) -> bool:
    """Whether the decoder refuses with its own error; any other error is a failure of the test."""
    try:
        decode(head, lists)
    except WireError as error:
        return str(error).endswith(".")
    return False


@settings(max_examples=150, deadline=None)
@given(data=st.data(), layout=st.sampled_from(LAYOUTS), words=st.sampled_from([2, 5]), views=st.integers(1, 3))
def test_damage_is_refused(data, layout, words, views):
    head, lists = encode(*several(views, layout, words))
    kind = data.draw(st.sampled_from(["truncate", "flip", "extend", "noise", "head"]))
    if kind == "truncate":
        assert refused(head, lists[: data.draw(st.integers(0, len(lists) - 1))])
        assert refused(head[: data.draw(st.integers(0, len(head) - 1))], lists)
    elif kind == "flip":
        at, bit = data.draw(st.integers(0, len(lists) - 1)), data.draw(st.integers(0, 7))
        assert refused(head, lists[:at] + bytes([lists[at] ^ 1 << bit]) + lists[at + 1 :])
    elif kind == "extend":
        assert refused(head, lists + data.draw(st.binary(min_size=1, max_size=64)))
    elif kind == "noise":
        assert refused(data.draw(st.binary(max_size=400)), data.draw(st.binary(max_size=400)))
    else:  # a changed head may be one that fits by chance (a matrix, the mode): it must never do harm
        at = data.draw(st.integers(0, len(head) - 1))
        changed = head[:at] + bytes([data.draw(st.integers(0, 255))]) + head[at + 1 :]
        assert refused(changed, lists) in (True, False)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6), layout=st.sampled_from(LAYOUTS))
def test_wrong_lists_with_a_right_checksum_do_no_harm(seed, layout):
    """Where it accepts, offsets and values are sound."""
    import zlib

    rng = np.random.default_rng(seed)
    head, lists = encode(message(4, layout, 2, 1))
    wrong = bytearray(lists)
    for at in rng.integers(0, len(wrong), rng.integers(1, 4)):
        wrong[at] = rng.integers(256)
    head = head[:32] + np.uint32(zlib.crc32(wrong)).tobytes() + head[36:]
    try:
        (got,) = decode(head, bytes(wrong))
    except WireError:
        return
    offsets, rows = got.nodes[0]
    assert offsets[0] == 0
    assert (np.diff(offsets) >= 0).all()
    assert offsets[-1] == len(rows)
    assert np.isfinite(rows[:, 1].copy().view(np.float32)).all()


@pytest.mark.parametrize(
    ("at", "value"),
    [
        (4, 99),
        (8, 4),
        (12, 2),
        (16, 0),
        (16, 1 << 31),
        (20, 70000),
        (24, 3),
        (28, 0),
        (28, 1 << 20),
        (36, 2),
        (40, 0x7FC00000),
    ],
)
def test_a_head_out_of_range_is_refused_before_anything_is_allocated(at, value):
    head, lists = encode(message())
    with pytest.raises(WireError):
        decode(head[:at] + np.uint32(value).tobytes() + head[at + 4 :], lists)


@pytest.mark.parametrize("count", [0, 1 << 27, (1 << 32) - 1])
def test_a_wrong_number_of_fragments_is_refused(count):
    head, lists = encode(message())
    with pytest.raises(WireError, match=r"announces|bytes"):
        decode(head[:44] + np.uint32(count).tobytes() + head[48:], lists)
