import numpy as np
import pytest

from studies.eigen import symmetric_eigen


@pytest.mark.parametrize("decades", [0, 12])
@pytest.mark.parametrize("n", [1, 2, 3, 7, 9])
def test_values_and_vectors_make_the_matrix_up_again(n, decades):
    rng = np.random.default_rng(n)
    axes = np.linalg.qr(rng.standard_normal((n, n)))[0]
    matrix = (axes * 10 ** rng.uniform(-decades, 0, n)) @ axes.T
    matrix = (matrix + matrix.T) / 2
    values, vectors = symmetric_eigen(matrix)
    np.testing.assert_allclose((vectors * values) @ vectors.T, matrix, atol=1e-14)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(n), atol=1e-13)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrix), atol=1e-14)


def test_the_signs_are_those_of_lapack_before_3_10():
    """Of NumPy 1.23.5 (LAPACK 3.9), from which NumPy 2.4 differs in two columns."""
    matrix = np.array([[9.0, 0, 2], [0, 7, 2], [2, 2, 2]])
    signs = [[-1, 1, -1], [-1, -1, -1], [1, -1, -1]]
    np.testing.assert_array_equal(np.sign(symmetric_eigen(matrix)[1]), signs)
