"""The work of GIST, beside the boxes and matrices that Placefield uses."""

import numpy as np

from placefield.features import gabor, gist
from placefield_tools.bench.gist_limit import bare, gist_work


def test_the_work_is_that_of_the_matrices_of_gist() -> None:
    half, bands, waves = 32, gabor._bands(64), gabor._padded_waves(64)
    low_pass = gist._low_pass(74)
    products = 4 * low_pass.size * 74
    products += 4 * waves[0].size * (half + waves.shape[1])
    for _, _, rows, columns, _ in bands.boxes.tolist():
        lines = 2 * 2 * half * rows * 2 * columns  # by x and y: (h, J) @ (J, re and im, L)
        products += lines + 2 * 4 * half * columns * half  # by x: (y, h, re and im, L) @ (L, h)
    read = sum(each.nbytes for each in (bands.waves, waves, low_pass))
    read += bands.gains.nbytes // 2  # each gain is kept twice, and is one number
    assert gist_work(64).products == products
    assert gist_work(64).bytes_read == read


def test_the_bare_work_multiplies_and_reads_as_much() -> None:
    work = gist_work(64)
    product, total = bare(work)()  # type: ignore[misc]
    multiplied = product.size * product[0, 0]  # ones: each element is the number of its products
    np.testing.assert_allclose([multiplied, 4 * total], [work.products, work.bytes_read], rtol=0.01)
