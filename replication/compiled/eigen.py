"""Eigenvectors of a small symmetric matrix, with the signs of LAPACK before 3.10 on every machine.

An eigenvector's sign is free, and a search that draws its samples along eigenvectors is another one if a sign flips.
LAPACK's own choice changed with its plane rotation (3.10); here the old rotation stays.
"""

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

EPSILON = 2.0**-53  # relative rounding error
TINY = 2.0**-1022  # smallest normal number
MOST_SWEEPS = 30  # for each eigenvalue; two or three are usual


def symmetric_eigen(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues and eigenvectors of a symmetric matrix.

    Householder's reduction of the lower triangle to a tridiagonal matrix, then implicit QL or QR sweeps (Golub and
    Van Loan, "Matrix Computations", sections 8.3 and 5.1), each step and each sign as in LAPACK's `dsyev` before
    version 3.10, in plain loops.

    Parameters
    ----------
    matrix : array of shape (n, n)
        Its upper triangle is not read.

    Returns
    -------
    values : array of shape (n,)
        Eigenvalues, ascending.
    vectors : array of shape (n, n)
        Column i belongs to eigenvalue i.

    Raises
    ------
    ValueError
        The matrix is not square, not finite, or its eigenvalues are not found.
    """
    matrix = np.array(matrix, dtype=float, order="C")
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not np.isfinite(matrix).all():
        raise ValueError(f"no eigenvalues: a finite square matrix is needed, this one has the shape {matrix.shape}")
    diagonal, beside, vectors = tridiagonal(matrix)
    if not diagonalise(diagonal, beside, vectors):
        raise ValueError("no eigenvalues: the sweeps do not converge")
    return diagonal, vectors


@numba.njit(cache=True)
def length(x, y):
    """Length of (x, y), without a library's `hypot`."""
    long, short = max(abs(x), abs(y)), min(abs(x), abs(y))
    return long if short == 0.0 else long * np.sqrt(1 + (short / long) ** 2)


@numba.njit(cache=True)
def tridiagonal(a):
    """Householder's reduction: diagonal, subdiagonal and the orthogonal matrix Q of Q T Q' = a; `a` is used up."""
    n = a.shape[0]
    tau = np.zeros(n)
    w = np.zeros(n)
    beside = np.zeros(n)
    for i in range(n - 1):
        below = 0.0
        for k in range(i + 2, n):
            below += a[k, i] * a[k, i]
        below = np.sqrt(below)
        beside[i] = a[i + 1, i]
        if below == 0.0:
            continue
        beta = -np.copysign(length(a[i + 1, i], below), a[i + 1, i])
        tau[i] = (beta - a[i + 1, i]) / beta
        for k in range(i + 2, n):
            a[k, i] /= a[i + 1, i] - beta
        beside[i] = beta
        a[i + 1, i] = 1.0  # v, the reflection's direction, stays in the column
        dot = 0.0
        for j in range(i + 1, n):
            w[j] = 0.0
            for k in range(i + 1, n):
                w[j] += a[max(j, k), min(j, k)] * a[k, i]
            w[j] *= tau[i]
            dot += w[j] * a[j, i]
        for j in range(i + 1, n):
            w[j] -= tau[i] / 2 * dot * a[j, i]
        for j in range(i + 1, n):
            for k in range(j, n):
                a[k, j] -= a[k, i] * w[j] + w[k] * a[j, i]
    diagonal = np.diag(a).copy()
    q = np.eye(n)
    for i in range(n - 2, -1, -1):
        for j in range(i + 1, n):
            dot = 0.0
            for k in range(i + 1, n):
                dot += a[k, i] * q[k, j]
            for k in range(i + 1, n):
                q[k, j] -= tau[i] * dot * a[k, i]
    return diagonal, beside, q


@numba.njit(cache=True)
def plane_rotation(f, g):
    """Cosine, sine and length r that turn (f, g) into (r, 0); c is negative only where f is and |f| <= |g|."""
    if g == 0.0:
        return 1.0, 0.0, f
    if f == 0.0:
        return 0.0, 1.0, g
    r = np.sqrt(f * f + g * g)
    c, s = f / r, g / r
    if abs(f) > abs(g) and c < 0.0:
        return -c, -s, -r
    return c, s, r


@numba.njit(cache=True)
def two_by_two(a, b, c):
    """Eigenvalues of [[a, b], [b, c]], the larger in size first, and the cosine and sine of its eigenvector."""
    total, difference = a + c, a - c
    root = length(difference, 2 * b)
    negative = total < 0.0
    first = 0.5 * (total - root) if negative else 0.5 * (total + root)
    large, small = (a, c) if abs(a) > abs(c) else (c, a)
    second = large / first * small - b / first * b if total != 0.0 else -0.5 * root
    ahead = difference >= 0.0
    cs = difference + root if ahead else difference - root
    if abs(cs) > abs(2 * b):
        t = -2 * b / cs
        s = 1 / np.sqrt(1 + t * t)
        c1, s1 = t * s, s
    elif b == 0.0:
        c1, s1 = 1.0, 0.0
    else:
        t = -cs / (2 * b)
        c1 = 1 / np.sqrt(1 + t * t)
        s1 = t * c1
    if ahead != negative:
        c1, s1 = -s1, c1
    return first, second, c1, s1


@numba.njit(cache=True)
def turn_columns(vectors, i, j, c, s):
    """Apply a plane rotation to two columns."""
    for k in range(vectors.shape[0]):
        x, y = vectors[k, i], vectors[k, j]
        vectors[k, i] = c * x + s * y
        vectors[k, j] = c * y - s * x


@numba.njit(cache=True)
def sweep(d, e, vectors, start, end, way):
    """One implicit sweep with Wilkinson's shift from `end` back to `start`: QL for way 1, QR for way -1."""
    at = min(0, way)  # e[i + at] lies between i and i + way
    p = d[start]
    g = (d[start + way] - p) / (2 * e[start + at])
    g = d[end] - p + e[start + at] / (g + np.copysign(length(g, 1.0), g))
    s, c, p = 1.0, 1.0, 0.0
    for i in range(end - way, start - way, -way):
        f, b = s * e[i + at], c * e[i + at]
        c, s, r = plane_rotation(g, f)
        if i != end - way:
            e[i + way + at] = r
        g = d[i + way] - p
        r = (d[i] - g) * s + 2 * c * b
        p = s * r
        d[i + way] = g + p
        g = c * r - b
        turn_columns(vectors, i + way, i, c, s)
    d[start] -= p
    e[start + at] = g


@numba.njit(cache=True)
def diagonalise(d, e, vectors):
    """Bring a tridiagonal matrix to diagonal form in place, ascending; False if it does not converge."""
    n = d.size
    left = MOST_SWEEPS * n
    first = 0
    while first < n:
        last = first
        while last < n - 1:
            if abs(e[last]) <= np.sqrt(abs(d[last])) * np.sqrt(abs(d[last + 1])) * EPSILON:
                e[last] = 0.0
                break
            last += 1
        following = last + 1
        start, end = (last, first) if abs(d[last]) < abs(d[first]) else (first, last)
        way = 1 if end >= start else -1
        at = min(0, way)
        while (end - start) * way >= 0:
            m = start
            while m != end and e[m + at] ** 2 > EPSILON**2 * abs(d[m]) * abs(d[m + way]) + TINY:
                m += way
            if m != end:
                e[m + at] = 0.0
            if m == start:
                start += way
            elif m == start + way:
                low = min(m, start)
                d[low], d[low + 1], c, s = two_by_two(d[low], e[low], d[low + 1])
                e[low] = 0.0
                turn_columns(vectors, low, low + 1, c, s)
                start += 2 * way
            elif left == 0:
                return False
            else:
                left -= 1
                sweep(d, e, vectors, start, m, way)
        first = following
    for i in range(n - 1):
        k = i + np.argmin(d[i:])
        if k != i:
            d[i], d[k] = d[k], d[i]
            for row in range(n):
                vectors[row, i], vectors[row, k] = vectors[row, k], vectors[row, i]
    return True
