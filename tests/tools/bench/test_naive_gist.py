import numpy as np
import pytest

from placefield_tools.bench.naive_gist import NaiveGist


def test_values_are_those_of_the_authors_code() -> None:
    y, x = np.indices((64, 64))
    feature = NaiveGist(64)(((7 * x + 13 * y + x * y // 16) % 256).astype(np.float32))
    np.testing.assert_allclose(feature[:4], [0.027698, 0.034157, 0.038667, 0.034970], atol=1e-6)
    assert feature.sum() == pytest.approx(27.01041, abs=1e-5)
    assert np.linalg.norm(feature) == pytest.approx(1.617329, abs=1e-6)


def test_an_even_image_has_no_shape() -> None:
    np.testing.assert_array_equal(NaiveGist(64)(np.full((64, 64), 128, np.float32)), 0)
