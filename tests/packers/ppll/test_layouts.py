"""Lists as the bytes that are sent: those of the format, and of the twin, on ordinary and on adversarial input."""

import numpy as np
import pytest

from shading_atlas_bench.kernels.inputs.soups import look_at, perspective, random_soup
from shading_atlas_bench.kernels.raster.camera import Camera
from shading_atlas_bench.packers.ppll.kernels.inputs import normal_lists, random_lists
from shading_atlas_bench.packers.ppll.kernels.lists import Lists, count_deleted, deleted_twin
from shading_atlas_bench.packers.ppll.kernels.rows import colour_rows, normal_rows
from shading_atlas_bench.packers.ppll.kernels.wire import LAYOUTS, write_lists, write_twin
from tests.packers.ppll.test_kernels import SIZE, build

# Fragments of each pixel: none at all, in one pixel of one, all in the last, the first or the middle one of several,
# one each, and more than any work-group has items.
COUNTS = [[0], [0, 0, 0], [1], [700], [0, 0, 300], [300, 0, 0], [0, 300, 0], [1, 1, 1], [0, 2000, 1, 0, 1, 400, 0]]


def lists_of(device, counts, words=2):
    rows = np.random.default_rng(len(counts)).integers(0, 2**32, (sum(counts), words), dtype=np.uint64)
    return Lists.upload(device, len(counts), 1, np.concatenate([[0], np.cumsum(counts)]), rows.astype(np.uint32))


def assert_written(device, nodes, layout):
    written = device.download(write_lists(device, nodes, layout, "wire"))
    assert written == b"".join(write_twin(offsets, rows, layout) for offsets, rows in (node.host() for node in nodes))
    assert len(written) == sum(4 * node.pixels + 4 * (node.words + 1) * node.count for node in nodes)


def test_the_bytes_are_those_of_the_format(device):
    """Three pixels with two, no and one fragment."""
    rows = np.array([[0x04030201, 10], [0x14131211, 20], [0x24232221, 30]], np.uint32)
    lists = Lists.upload(device, 3, 1, np.array([0, 2, 2, 3]), rows)
    expected = [1, 0, 3, 0x04030201, 10, 2, 0x14131211, 20, 0, 0x24232221, 30, 0]
    assert write_lists(device, [lists], "paper", "wire").get().tolist() == expected
    header, follows = [1, 0, 1, *[0] * 9], [1, 0, 0, *[0] * 9]
    colours = [k + 0x10 * fragment for k in (1, 2, 3, 4) for fragment in range(3)]
    shuffled = bytes([*header, *colours, 10, 20, 30, *[0] * 9, *follows])
    assert device.download(write_lists(device, [lists], "shuffled", "wire")) == shuffled


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("words", [2, 5])
@pytest.mark.parametrize("counts", COUNTS, ids=str)
def test_odd_lists_are_written_as_by_the_twin(device, counts, words, layout):
    assert_written(device, [lists_of(device, counts, words)], layout)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_nodes_follow_each_other(device, layout, monkeypatch):
    rng = np.random.default_rng(20)
    colours = [lists_of(device, [0] * 384), random_lists(device, rng, most=50), random_lists(device, rng)]
    normals = [normal_lists(device, rng), normal_lists(device, rng, most=40)]
    for local_size in (64, 1, 7, 256):
        monkeypatch.setattr(device, "local_size", local_size)
        for nodes in (colours, normals):
            assert_written(device, nodes, layout)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_drawn_fragments_are_written_as_by_the_twin(device, layout):
    rng, projection = np.random.default_rng(21), perspective()
    triangles = random_soup(device, rng, 500)
    fragments = build(device, triangles, Camera.of(look_at((0, 1, 9), (0, 0, 0)), projection, *SIZE))
    n, vertices = fragments.count, rng.normal(size=(len(triangles.host_positions), 8)).astype(np.float32)
    known = (device, fragments, device.upload(rng.integers(0, 256, (1, n, 4)).astype(np.uint8)), None)
    drawn = (colour_rows(*known, "rows"), normal_rows(*known, triangles, device.upload(vertices), projection, "rows"))
    assert n > 1000
    for words, rows in zip((2, 5), drawn, strict=True):
        assert_written(device, [Lists(*SIZE, n, words, fragments.offsets, rows)], layout)


def test_other_layouts_are_refused(device):
    with pytest.raises(ValueError, match=r"'columns'.*paper, shuffled"):
        write_lists(device, [lists_of(device, [1])], "columns", "wire")


@pytest.mark.parametrize("counts", COUNTS, ids=str)
def test_deleted_fragments_are_counted(device, counts, monkeypatch):
    lists = lists_of(device, counts, 2)
    offsets, rows = lists.host()
    rows[::3, 0] &= 0xFFFFFF
    lists = Lists.upload(device, len(counts), 1, offsets, rows)
    for chunks in (64, 1, 7):
        monkeypatch.setattr(device, "chunks", chunks)
        assert count_deleted(device, lists, "count") == deleted_twin(lists.host())
    assert count_deleted(device, lists, "count") >= -(-len(rows) // 3)
