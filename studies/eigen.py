"""Eigenvectors of a small symmetric matrix, with the signs of LAPACK's `dsyev` before 3.10.

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
    """Eigenvalues of a symmetric matrix, ascending, and its eigenvectors in columns."""
    tridiagonal, vectors = hessenberg(matrix, calc_q=True)
    values = tridiagonal.diagonal().copy()
    make_diagonal(values, tridiagonal.diagonal(-1).copy(), vectors)
    order = np.argsort(values, kind="stable")
    return values[order], np.take(vectors, order, axis=1)


@njit
def make_diagonal(d, e, vectors):
    """Bring a tridiagonal matrix with d on and e beside its diagonal to diagonal form in place.

    One block without zeros beside the diagonal at a time, from that of its ends where d is smaller.
    """
    first = 0
    while first < d.size:
        last = first
        while last < e.size:
            if abs(e[last]) <= np.sqrt(abs(d[last])) * np.sqrt(abs(d[last + 1])) * EPSILON:
                break
            last += 1
        way = -1 if abs(d[last]) < abs(d[first]) else 1
        block = vectors[:, first : last + 1]
        diagonalise(d[first : last + 1][::way], e[first:last][::way], block[:, ::way], way)
        first = last + 1


@njit
def diagonalise(d, e, vectors, way):
    """Bring a block to diagonal form from its start; `way` is -1 if it is turned round."""
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
            turn_columns(vectors, low, high, c, s)
            start += 2
        else:
            sweep(d, e, vectors, start, m)


@njit
def length(x, y):
    """Length of (x, y), without a library's `hypot`."""
    long, short = max(abs(x), abs(y)), min(abs(x), abs(y))
    return long * np.sqrt(1 + (short / long) ** 2)


@njit
def sweep(d, e, vectors, start, end):
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
        turn_columns(vectors, i + 1, i, c, s)
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
    """Eigenvalues of [[a, b], [b, c]], the larger in size first; cosine, sine of its vector."""
    total, difference = a + c, a - c
    root = length(difference, 2 * b)
    sign, side = np.copysign(1.0, total), np.copysign(1.0, difference)
    first = 0.5 * (total + sign * root)
    large, small = (a, c) if abs(a) > abs(c) else (c, a)
    second = large / first * small - b / first * b
    cs = difference + side * root
    if abs(cs) > abs(2 * b):
        t = -2 * b / cs
        sine = 1 / np.sqrt(1 + t * t)
        cosine = t * sine
    else:
        t = -cs / (2 * b)
        cosine = 1 / np.sqrt(1 + t * t)
        sine = t * cosine
    return (first, second, -sine, cosine) if side == sign else (first, second, cosine, sine)


@njit
def turn_columns(vectors, i, j, c, s):
    """Apply a plane rotation to two columns."""
    for k in range(vectors.shape[0]):
        x, y = vectors[k, i], vectors[k, j]
        vectors[k, i] = c * x + s * y
        vectors[k, j] = c * y - s * x
