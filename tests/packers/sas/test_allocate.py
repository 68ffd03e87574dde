"""The allocator over random frames: its invariants, and the same words as its twin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.packers.sas.kernels.allocate import (
    Allocator,
    AllocatorTwin,
    SuperblockGrid,
    classes_of,
    request_twin,
)
from shading_atlas_bench.packers.sas.kernels.bias import Request
from shading_atlas_bench.packers.sas.kernels.layout import unpack_location
from shading_atlas_bench.packers.sas.kernels.visible import Marks, VisiblePatches


def visible_frames(rng: np.random.Generator, patches: int, frames: int, churn: float, largest: int):
    """Per frame the visible patches in any fixed order, and their sizes; some leave, come back and change size."""
    order = rng.permutation(patches)
    visible = rng.random(patches) < 0.6
    sizes = rng.integers(0, largest + 1, (patches, 2))
    for _ in range(frames):
        chosen = order[visible[order]].astype(np.int32)
        yield chosen, (sizes[chosen, 0] | sizes[chosen, 1] << 8).astype(np.int32)
        visible ^= rng.random(patches) < churn / 2
        changed = rng.random(patches) < churn
        sizes[changed] = np.clip(sizes[changed] + rng.integers(-9, 10, (changed.sum(), 2)), 0, largest)


def allocate(device, allocator: Allocator, patches: np.ndarray, sizes: np.ndarray, bias: int) -> np.ndarray:
    """Run one frame with patches of one triangle each, numbered alike; the words of all patches."""
    count = len(allocator.words)
    marks = np.zeros(count, np.int32)
    marks[patches] = 1
    members = np.full((count, 3), -1, np.int32)
    members[:, 0] = np.arange(count)
    visible = VisiblePatches(len(patches), device.upload(patches), device.empty(len(patches), np.uint8))
    request = Request(device.upload(sizes), bias)
    allocator.allocate(visible, request, device.upload(members), Marks(device.upload(marks), 1))
    return allocator.words.get()


def assert_disjoint_and_inside(words: np.ndarray, grid: SuperblockGrid) -> None:
    """Blocks lie inside the atlas, inside one superblock each, and share no texel."""
    x, y, w, h = unpack_location(words[words > 0])
    side = 1 << grid.top
    atlas = np.zeros((grid.rows * side, grid.columns * side), np.int64)
    for x0, y0, x1, y1 in zip(x, y, x + (1 << w), y + (1 << h), strict=True):
        assert 0 <= x0 < x1 <= atlas.shape[1]
        assert 0 <= y0 < y1 <= atlas.shape[0]
        assert (x0 // side, y0 // side) == ((x1 - 1) // side, (y1 - 1) // side)
        atlas[y0:y1, x0:x1] += 1
    assert atlas.max(initial=0) <= 1


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    top=st.integers(0, 5),
    columns=st.integers(1, 5),
    rows=st.integers(1, 5),
    patches=st.integers(1, 300),
    churn=st.sampled_from([0.02, 0.3, 1.0]),
    reuse=st.booleans(),
    bias=st.integers(0, 20),
)
def test_blocks_stay_apart_and_in_place(device, seed, top, columns, rows, patches, churn, reuse, bias):
    rng = np.random.default_rng(seed)
    grid = SuperblockGrid(top, columns, rows)
    allocator, twin = Allocator(device, grid, patches, reuse), AllocatorTwin(grid, patches, reuse)
    before, resets = np.zeros(patches, np.uint32), 0
    for visible, sizes in visible_frames(rng, patches, 6, churn, 8 * top):
        words = allocate(device, allocator, visible, sizes, bias)
        twin.allocate(visible, sizes, bias)
        np.testing.assert_array_equal(words, twin.words)
        assert allocator.resets == twin.resets
        assert_disjoint_and_inside(words, grid)
        asked = request_twin(sizes, bias, top, np.zeros(len(visible), np.uint32))[0]
        placed = words[visible] > 0
        np.testing.assert_array_equal(classes_of(words[visible], top)[placed], asked[placed])
        if allocator.resets == resets:
            unchanged = (before[visible] > 0) & (classes_of(before[visible], top) == asked)
            np.testing.assert_array_equal(words[visible][unchanged], before[visible][unchanged])
            assert placed.all()
        before, resets = words, allocator.resets
        assert allocator.superblocks_in_use() <= grid.total
        in_use = words > 0 if reuse else np.zeros(patches, bool)
        blocks = allocator.blocks_by_class()
        np.testing.assert_array_less(-1, blocks)
        if reuse:
            np.testing.assert_array_equal(blocks, np.bincount(classes_of(words[in_use], top), minlength=grid.classes))


def test_resets_only_when_full(device):
    """Two superblocks of four blocks: the third size class finds none, all is given up, the two asked for now fit."""
    grid = SuperblockGrid(2, 2, 1)
    allocator = Allocator(device, grid, 8, reuse=False)
    small, wide, tall = 8 | 8 << 8, 16 | 8 << 8, 8 | 16 << 8
    patches = np.arange(4, dtype=np.int32)
    for size, resets in ((small, 0), (wide, 0), (tall, 1), (small, 1), (wide, 2)):
        words = allocate(device, allocator, patches[:2], np.full(2, size, np.int32), 0)
        assert allocator.resets == resets
        assert (words[:2] > 0).all()


def test_reuse_avoids_the_reset(device):
    grid = SuperblockGrid(2, 1, 1)
    sizes = np.full(4, 8 | 8 << 8, np.int32)
    resets = []
    for reuse in (False, True):
        allocator = Allocator(device, grid, 8, reuse)
        for patches in (np.arange(4), np.arange(4, 8), np.arange(4)):
            words = allocate(device, allocator, patches.astype(np.int32), sizes, 0)
            assert (words[patches] > 0).all()
        resets.append(allocator.resets)
    assert resets == [2, 0]


def test_a_hidden_patch_finds_its_block_again(device):
    allocator = Allocator(device, SuperblockGrid(4, 4, 4), 20, reuse=False)
    first = allocate(device, allocator, np.arange(10, dtype=np.int32), np.full(10, 8, np.int32), 0)
    allocate(device, allocator, np.arange(10, 20, dtype=np.int32), np.full(10, 8, np.int32), 0)
    again = allocate(device, allocator, np.arange(10, dtype=np.int32), np.full(10, 8, np.int32), 0)
    np.testing.assert_array_equal(first[:10], again[:10])


@pytest.mark.parametrize("reuse", [False, True])
def test_more_patches_than_texels_leave_the_last_without_a_block(device, reuse):
    grid = SuperblockGrid(0, 4, 4)
    allocator = Allocator(device, grid, 40, reuse)
    for _ in range(2):
        words = allocate(device, allocator, np.arange(40, dtype=np.int32), np.full(40, 99, np.int32), 127)
        np.testing.assert_array_equal(words > 0, np.arange(40) < 16)


def test_no_patch_is_no_request(device):
    allocator = Allocator(device, SuperblockGrid(3, 2, 2), 5, reuse=True)
    words = allocate(device, allocator, np.empty(0, np.int32), np.empty(0, np.int32), 0)
    assert (words == 0).all()
    assert allocator.superblocks_in_use() == 0
