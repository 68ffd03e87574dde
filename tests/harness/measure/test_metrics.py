"""The picture metrics of a frame together: empty values, sharing of the reference, determinism."""

import numpy as np
import pytest

from shading_atlas_bench.harness.measure.metrics import Metrics
from shading_atlas_bench.kernels.inputs.pictures import damaged, flat, on_device, rendering
from shading_atlas_bench.reports.store.columns import BY_NAME, MEASURES, PICTURE_METRICS


@pytest.fixture(scope="module")
def metrics(device):
    return Metrics(device)


def test_every_metric_says_what_it_is():
    names = [measure.name for measure in MEASURES]
    assert len(set(names)) == len(names)
    assert set(PICTURE_METRICS) <= set(names)
    assert all(len(measure.meaning) > 10 for measure in MEASURES)
    assert all(BY_NAME[name].better in ("lower", "higher") for name in PICTURE_METRICS)


def test_worse_pictures_get_worse_numbers(device, metrics):
    reference = rendering(170, 200)
    metrics.reference(on_device(device, reference))
    mild, strong = (
        metrics.compare(
            on_device(
                device,
                np.clip(reference + np.random.default_rng(0).normal(0, s, (170, 200, 3)), 0, 255).astype(np.uint8),
            )
        )
        for s in (3, 20)
    )
    for name in PICTURE_METRICS:
        assert (mild[name] < strong[name]) == (BY_NAME[name].better == "lower")


def test_identical_pictures(device, metrics):
    picture = on_device(device, rendering(165, 180))
    metrics.reference(picture)
    assert metrics.compare(picture) == {"flip": 0, "dssim": 0, "iwssim": 1, "psnr": None, "delta_e": 0}
    assert metrics.reasons == {}
    assert metrics.flip_map().shape == (165, 180, 3)


@pytest.mark.parametrize(
    ("size", "missing"), [((100, 300), {"iwssim"}), ((10, 200), {"iwssim", "dssim"}), ((1, 1), {"iwssim", "dssim"})]
)
def test_pictures_too_small_give_an_empty_value_and_a_reason(device, metrics, size, missing):
    reference, test = (flat(size[0], size[1], colour) for colour in ((10, 20, 30), (40, 20, 30)))
    metrics.reference(on_device(device, reference))
    values = metrics.compare(on_device(device, test))
    assert {name for name, value in values.items() if value is None} == missing
    assert set(metrics.reasons) == missing
    assert all(f"{size[1]}x{size[0]}" in reason for reason in metrics.reasons.values())


def test_one_reference_serves_many_comparisons_in_any_order(device, metrics):
    reference = rendering(170, 190, seed=2)
    tests = [on_device(device, damaged(reference, kind)) for kind in ("noise", "blur", "shift")]
    metrics.reference(on_device(device, reference))
    first = [metrics.compare(test) for test in tests]
    assert [metrics.compare(test) for test in reversed(tests)] == first[::-1]
    other = Metrics(device)
    other.reference(on_device(device, reference))
    assert other.compare(tests[1]) == first[1]


def test_flip_alone_is_that_of_all_metrics_where_it_is_wanted(device, metrics):
    reference = rendering(40, 60)
    test = on_device(device, damaged(reference, "noise"))
    for one in (metrics, Metrics(device, ["psnr"]), Metrics(device, ["psnr"], ["flip"])):
        one.reference(on_device(device, reference))
        flip, wanted = one.compare(test)["flip"], "flip" in one.wanted
        assert (flip is None) != wanted
        assert one.compare(test, ("flip",)) == {"flip": flip}
        assert (one.flip_map() is None) != wanted


@pytest.mark.parametrize("local_size", [1, 7, 256])
def test_no_work_group_size_changes_a_number(device, metrics, local_size):
    reference, before = rendering(163, 201), device.local_size
    test = on_device(device, damaged(reference, "noise"))
    metrics.reference(on_device(device, reference))
    expected, expected_map = metrics.compare(test), metrics.flip_map()
    device.local_size = local_size
    try:
        metrics.reference(on_device(device, reference))
        assert metrics.compare(test) == expected
        np.testing.assert_array_equal(metrics.flip_map(), expected_map)
    finally:
        device.local_size = before


def test_a_picture_of_another_size_is_refused(device, metrics):
    metrics.reference(on_device(device, flat(20, 30, (0, 0, 0))))
    with pytest.raises(ValueError, match="31x20"):
        metrics.compare(on_device(device, flat(20, 31, (0, 0, 0))))
