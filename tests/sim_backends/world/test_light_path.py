import numpy as np
import pytest

from sim_backends.world.light_path import in_blocks


@pytest.mark.parametrize("rows", [1, 7, 8, 9, 20])
def test_number_of_images_changes_no_byte(rows: int) -> None:
    rng = np.random.default_rng(3)
    images, matrix = rng.random((20, 100)).astype(np.float32), rng.random((100, 333)).astype(np.float32)
    assert np.array_equal(in_blocks(images[:rows], matrix), in_blocks(images, matrix)[:rows])
