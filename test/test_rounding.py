import numpy as np

from layered_cbf_ros.rounding import rounded


def test_rounding_removes_noise_and_hardly_changes_a_value():
    values = np.random.default_rng(0).uniform(-33.5, 33.5, 1000)
    clean = rounded(values, 1e-4)
    np.testing.assert_allclose(clean, values, atol=0.51e-4)
    np.testing.assert_array_equal(rounded(clean + 1e-12, 1e-4), clean)
