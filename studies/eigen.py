"""Eigenvectors of a small covariance matrix, with the signs of LAPACK's `dsyev` before 3.10.

An eigenvector's sign is free, and a search that draws its samples along eigenvectors is another one
if a sign flips. LAPACK's own choice changed with its plane rotation (3.10); here the old rotation
stays. The method is in Golub and Van Loan, "Matrix Computations", section 8.3.
"""

import numpy as np
from scipy.linalg import hessenberg

from replication.compilation import njit
from replication.signature import FloatArray

EPSILON = 2.0**-53  # relative rounding error
TINY = 2.0**-1022  # smallest normal number


def symmetric_eigen(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues of a positive definite matrix, ascending, and its eigenvectors in columns."""
    tridiagonal, vectors = hessenberg(matrix, calc_q=True)
    d, e = tridiagonal.diagonal().copy(), tridiagonal.diagonal(-1).copy()
    way = -1 if d[-1] < d[0] else 1  # from the end where d is smaller
    diagonalise(d[::way], e[::way], vectors.T[::way], way)
    order = np.argsort(d, kind="stable")
    return d[order], np.take(vectors, order, axis=1)


@njit
def diagonalise(d, e, rows, way):
    """Bring a matrix with d on and e beside its diagonal to diagonal form; `way` is -1 if it is turned round."""
    start = 0
    while start < d.size:
        m = start
        while m < e.size and e[m] ** 2 > EPSILON**2 * abs(d[m]) * abs(d[m + 1]) + TINY:
            m += 1
        if m < e.size:
            e[m] = 0.0
        if m == start:
            start += 1
        elif m == start + 1:
            low, high = (start, m) if way > 0 else (m, start)
            d[low], d[high], c, s = two_by_two(d[low], e[start], d[high])
            turn_rows(rows, low, high, c, s)
            start += 2
        else:
            sweep(d, e, rows, start, m)


@njit
def length(x, y):
    """Length of (x, y), without a library's `hypot`."""
    long, short = max(abs(x), abs(y)), min(abs(x), abs(y))
    return long * np.sqrt(1 + (short / long) ** 2)


@njit
def sweep(d, e, rows, start, end):
    """One implicit QL sweep by Wilkinson's shift from `end` to `start`."""
    p = d[start]
    g = (d[start + 1] - p) / (2 * e[start])
    g = d[end] - p + e[start] / (g + np.copysign(length(g, 1.0), g))
    s = c = 1.0
    p = 0.0
    for i in range(end - 1, start - 1, -1):
        f, b = s * e[i], c * e[i]
        c, s, r = plane_rotation(g, f)
        if i < end - 1:
            e[i + 1] = r
        g = d[i + 1] - p
        r = (d[i] - g) * s + 2 * c * b
        p = s * r
        d[i + 1] = g + p
        g = c * r - b
        turn_rows(rows, i + 1, i, c, s)
    d[start] -= p
    e[start] = g


@njit
def plane_rotation(f, g):
    """Cosine, sine and length r that turn (f, g) into (r, 0).

    The cosine is negative only where f is and |f| <= |g|.
    """
    if g == 0.0:
        return 1.0, 0.0, f
    if f == 0.0:
        return 0.0, 1.0, g
    r = np.sqrt(f * f + g * g)
    if abs(f) > abs(g) and f < 0.0:
        r = -r
    return f / r, g / r, r


@njit
def two_by_two(a, b, c):
    """Eigenvalues of [[a, b], [b, c]], positive definite, the larger first; cosine, sine of its vector."""
    difference = a - c
    root = length(difference, 2 * b)
    first = 0.5 * (a + c + root)
    second = max(a, c) / first * min(a, c) - b / first * b
    cs = difference + np.copysign(root, difference)
    if abs(cs) > abs(2 * b):
        t = -2 * b / cs
        sine = 1 / np.sqrt(1 + t * t)
        cosine = t * sine
    else:
        t = -cs / (2 * b)
        cosine = 1 / np.sqrt(1 + t * t)
        sine = t * cosine
    return (first, second, -sine, cosine) if difference >= 0 else (first, second, cosine, sine)


@njit
def turn_rows(rows, i, j, c, s):
    """Apply a plane rotation to two rows."""
    rows[i], rows[j] = c * rows[i] + s * rows[j], c * rows[j] - s * rows[i]
