"""Eigenvectors of a small symmetric matrix, with the signs of LAPACK's `dsyev` before 3.10 on every machine.

An eigenvector's sign is free, and a search that draws its samples along eigenvectors is another one
if a sign flips. LAPACK's own choice changed with its plane rotation (3.10); here the old rotation
stays. The method is in Golub and Van Loan, "Matrix Computations", sections 5.1 and 8.3; every sum
is taken in order, without BLAS.
"""

import numpy as np

from replication.compilation import njit
from replication.signature import FloatArray

EPSILON = 2.0**-53  # relative rounding error
TINY = 2.0**-1022  # smallest normal number
MOST_SWEEPS = 30  # for each eigenvalue; two or three are usual


def symmetric_eigen(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues of a symmetric matrix, ascending, and its eigenvectors in columns."""
    values, beside, vectors = make_tridiagonal(matrix.copy())
    make_diagonal(values, beside, vectors)
    order = np.argsort(values, kind="stable")
    return values[order], np.take(vectors, order, axis=1)


@njit
def length(x, y):
    """Length of (x, y), without a library's `hypot`."""
    long, short = max(abs(x), abs(y)), min(abs(x), abs(y))
    return long if short == 0.0 else long * np.sqrt(1 + (short / long) ** 2)


@njit
def dot(x, y):
    """Sum of products, in order."""
    total = 0.0
    for k in range(x.size):
        total += x[k] * y[k]
    return total


@njit
def make_tridiagonal(a):
    """Householder's reduction: diagonal, subdiagonal and the orthogonal matrix Q of Q T Q' = a.

    `a` is used up. Loops compile in a tenth of the time of array expressions.
    """
    n = a.shape[0]
    tau = np.zeros(n)
    beside = np.zeros(n)
    q = np.eye(n)
    w = np.zeros(n)
    for i in range(n - 1):
        v, rest = a[i + 1 :, i], a[i + 1 :, i + 1 :]
        beside[i] = v[0]
        below = np.sqrt(dot(v[1:], v[1:]))
        if below == 0.0:
            continue
        beside[i] = -np.copysign(length(v[0], below), v[0])
        tau[i] = (beside[i] - v[0]) / beside[i]
        scale = v[0] - beside[i]
        v[0] = 1.0  # the reflection's direction stays in the column
        for k in range(1, v.size):
            v[k] /= scale
        for k in range(v.size):
            w[k] = tau[i] * dot(rest[k], v)
        half = tau[i] / 2 * dot(v, w)
        for k in range(v.size):
            w[k] -= half * v[k]
        for j in range(v.size):
            for k in range(v.size):
                rest[j, k] -= v[j] * w[k] + w[j] * v[k]
    for i in range(n - 2, -1, -1):
        v, block = a[i + 1 :, i], q[i + 1 :, i + 1 :]
        for k in range(v.size):
            turned = tau[i] * dot(v, block[:, k])
            for j in range(v.size):
                block[j, k] -= v[j] * turned
    return np.diag(a).copy(), beside, q


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
    sign = -1.0 if total < 0.0 else 1.0
    first = 0.5 * (total + sign * root)
    large, small = (a, c) if abs(a) > abs(c) else (c, a)
    second = large / first * small - b / first * b if total != 0.0 else -0.5 * root
    side = 1.0 if difference >= 0.0 else -1.0
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


@njit
def sweep(d, e, vectors, start, end, way):
    """One implicit sweep by Wilkinson's shift from `end` to `start`: QL for way 1, QR for -1."""
    at = min(0, way)  # e[i + at] lies between i and i + way
    p = d[start]
    g = (d[start + way] - p) / (2 * e[start + at])
    g = d[end] - p + e[start + at] / (g + np.copysign(length(g, 1.0), g))
    s = c = 1.0
    p = 0.0
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


@njit
def make_diagonal(d, e, vectors):
    """Bring a tridiagonal matrix to diagonal form in place, one block without zeros beside the diagonal at a time."""
    sweeps_left = MOST_SWEEPS * d.size
    first = 0
    while first < d.size:
        last = first
        while last < d.size - 1:
            if abs(e[last]) <= np.sqrt(abs(d[last])) * np.sqrt(abs(d[last + 1])) * EPSILON:
                e[last] = 0.0
                break
            last += 1
        start, end = (last, first) if abs(d[last]) < abs(d[first]) else (first, last)
        first = last + 1
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
            elif sweeps_left == 0:
                raise ValueError("no eigenvalues: the sweeps do not converge")
            else:
                sweeps_left -= 1
                sweep(d, e, vectors, start, m, way)
