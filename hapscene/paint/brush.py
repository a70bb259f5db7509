"""The brush's walk over the surface, compiled: from face to face while they are under it.

A brush of radius r moves along a segment. The walk starts at the faces at its two ends and goes on to every face that
shares a vertex with one already reached, is nearer than r to the segment (triangle against segment, after Ericson,
Real-Time Collision Detection (2005), 5.1.5, 5.1.9 and 5.1.10), and looks the same way as one of the ends.
"""

from typing import Any, Final

from hapscene.contact.geometry import Vector, dot, sub
from hapscene.native import native

WAY_SHARE: Final = 0.1
"""How near the way must pass by a face that counts as gone over, in radii of the brush [1]: more than a chord of a
short way leaves the surface by, and too little to be seen as a wider brush."""


@native
def point_triangle(p: Vector, a: Vector, b: Vector, c: Vector) -> float:
    """Squared distance [m²] of a point from a triangle."""
    ab, ac, ap = sub(b, a), sub(c, a), sub(p, a)
    d1, d2 = dot(ab, ap), dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return dot(ap, ap)
    bp = sub(p, b)
    d3, d4 = dot(ab, bp), dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return dot(bp, bp)
    cp = sub(p, c)
    d5, d6 = dot(ab, cp), dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return dot(cp, cp)
    vc, vb, va = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return _off(ap, ab, d1 / (d1 - d3))
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return _off(ap, ac, d2 / (d2 - d6))
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        return _off(bp, sub(c, b), (d4 - d3) / ((d4 - d3) + (d5 - d6)))
    total = va + vb + vc
    if total <= 0.0:  # no area: its edges are all there is
        return min(
            _off(ap, ab, _share(ap, ab)), _off(ap, ac, _share(ap, ac)), _off(bp, sub(c, b), _share(bp, sub(c, b)))
        )
    v, w = vb / total, vc / total
    gap = (ap[0] - v * ab[0] - w * ac[0], ap[1] - v * ab[1] - w * ac[1], ap[2] - v * ab[2] - w * ac[2])
    return dot(gap, gap)


@native
def _share(ap: Vector, ab: Vector) -> float:
    """Where on a segment a point is nearest to, 0 to 1."""
    length2 = dot(ab, ab)
    return min(max(dot(ap, ab) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0


@native
def _off(ap: Vector, ab: Vector, t: float) -> float:
    """Squared distance from a + t ab."""
    gap = (ap[0] - t * ab[0], ap[1] - t * ab[1], ap[2] - t * ab[2])
    return dot(gap, gap)


@native
def segment_segment(p: Vector, q: Vector, a: Vector, b: Vector) -> float:
    """Squared distance [m²] of two segments."""
    d1, d2, r = sub(q, p), sub(b, a), sub(p, a)
    l1, l2, f = dot(d1, d1), dot(d2, d2), dot(d2, r)
    if l1 == 0.0:
        return _off(sub(p, a), d2, _share(sub(p, a), d2))
    c = dot(d1, r)
    if l2 == 0.0:
        return _off(sub(a, p), d1, _share(sub(a, p), d1))
    both = dot(d1, d2)
    across = l1 * l2 - both * both
    s = min(max((both * f - c * l2) / across, 0.0), 1.0) if across > 1e-14 * l1 * l2 else 0.0
    t = (both * s + f) / l2
    if t < 0.0:
        t, s = 0.0, min(max(-c / l1, 0.0), 1.0)
    elif t > 1.0:
        t, s = 1.0, min(max((both - c) / l1, 0.0), 1.0)
    gap = (
        r[0] + s * d1[0] - t * d2[0],
        r[1] + s * d1[1] - t * d2[1],
        r[2] + s * d1[2] - t * d2[2],
    )
    return dot(gap, gap)


@native
def pierces(p: Vector, q: Vector, a: Vector, b: Vector, c: Vector) -> bool:
    """Whether a segment goes through a triangle."""
    ab, ac, pq, ap = sub(b, a), sub(c, a), sub(q, p), sub(p, a)
    n = (ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2], ab[0] * ac[1] - ab[1] * ac[0])
    over, under = dot(n, ap), dot(n, pq)
    if under == 0.0 or over * (over + under) > 0.0:
        return False
    t = -over / under
    x = (ap[0] + t * pq[0], ap[1] + t * pq[1], ap[2] + t * pq[2])
    bb, bc, cc, xb, xc = dot(ab, ab), dot(ab, ac), dot(ac, ac), dot(x, ab), dot(x, ac)
    det = bb * cc - bc * bc
    if det <= 0.0:
        return False
    v, w = (cc * xb - bc * xc) / det, (bb * xc - bc * xb) / det
    return bool(v >= 0.0 and w >= 0.0 and v + w <= 1.0)


@native
def segment_triangle(p: Vector, q: Vector, a: Vector, b: Vector, c: Vector) -> float:
    """Squared distance [m²] of a segment from a triangle."""
    if pierces(p, q, a, b, c):
        return 0.0
    return min(
        point_triangle(p, a, b, c),
        point_triangle(q, a, b, c),
        segment_segment(p, q, a, b),
        segment_segment(p, q, b, c),
        segment_segment(p, q, c, a),
    )


@native
def _corner(corner_m: Any, face: int, k: int) -> Vector:
    return corner_m[face, k, 0], corner_m[face, k, 1], corner_m[face, k, 2]


@native
def reach(
    shape: Any, net: Any, work: Any, number: int, ends: Any, points: Any, radius_m: float, facing_cos: float
) -> int:
    """Write the faces under the brush into the last array of `work`; how many they are.

    Args:
        shape: corners (M, 3, 3), centroids (M, 3) [m] and unit normals (M, 3).
        net: welded vertices (M, 3), and face corners around each vertex: (3M,) from (N + 1,) on.
        work: of the faces and of the vertices in which round they were seen (M,), (N,); two lists of faces (M,).
        number: of this round, above all before it.
        ends: faces at both ends of the way.
        points: places there [m].
        radius_m: of the brush [m].
        facing_cos: cosine of the most that a face may be turned from both ends' [1].
    """
    corner_m, centroid_m, normal = shape
    vertex, around, start = net
    seen_face, seen_vertex, queue, painted = work
    p, q = points
    radius2, way2 = radius_m * radius_m, (WAY_SHARE * radius_m) ** 2
    count = waiting = 0
    for end in ends:
        if seen_face[end] != number:
            seen_face[end] = number
            queue[waiting] = end
            waiting += 1
            painted[count] = end
            count += 1
    n0 = (normal[ends[0], 0], normal[ends[0], 1], normal[ends[0], 2])
    n1 = (normal[ends[1], 0], normal[ends[1], 1], normal[ends[1], 2])
    at = 0
    while at < waiting:
        face = queue[at]
        at += 1
        for k in range(3):
            v = vertex[face, k]
            if seen_vertex[v] == number:
                continue
            seen_vertex[v] = number
            for i in range(start[v], start[v + 1]):
                other = around[i] // 3
                if seen_face[other] == number:
                    continue
                seen_face[other] = number
                n = (normal[other, 0], normal[other, 1], normal[other, 2])
                flat = n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0
                if not flat and dot(n, n0) < facing_cos and dot(n, n1) < facing_cos:
                    continue
                a, b, c = _corner(corner_m, other, 0), _corner(corner_m, other, 1), _corner(corner_m, other, 2)
                away2 = segment_triangle(p, q, a, b, c)
                if away2 > radius2:
                    continue
                queue[waiting] = other
                waiting += 1
                middle = (centroid_m[other, 0], centroid_m[other, 1], centroid_m[other, 2])
                gap = sub(middle, p)
                way = sub(q, p)
                if away2 <= way2 or _off(gap, way, _share(gap, way)) <= radius2:
                    painted[count] = other
                    count += 1
    return count
