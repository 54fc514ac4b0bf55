"""CoSPAIR's layout (experiments/descriptors/cospair.toml), computed from its definition without any code of Descry.

Usage: cospair.py DATA QUERY DATABASE... [--out FILE], where QUERY and DATABASE are lists below DATA; needs numpy.

Writes what `coordinator evaluate --nearest FILE` writes, to compare: query, nearest cloud, distance on each line. Reads
PCD as `coordinator synth` writes it: x, y, z and rgb as binary_compressed.
"""

import argparse
import pathlib
import struct
import sys

import numpy as np

GRID, NORMALS, RADIUS = 0.02, 0.01, 0.05  # metres
SHELLS, BINS = 7, 9
RANGES = [(-np.pi, np.pi), (0, np.pi), (0, np.pi), (0, 1), (-1, 1), (-1, 1)]  # of f1 a2 a3 L a b
LEAST_POINTS = 10


def decompressed(data, size):
    """LZF: literal runs, and copies of what is already there."""
    out, at = bytearray(), 0
    while at < len(data):
        control = data[at]
        at += 1
        if control < 32:
            out += data[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += data[at]
            at += 1
        back = ((control & 31) << 8) + data[at] + 1
        at += 1
        for _ in range(length + 2):
            out.append(out[-back])
    assert len(out) == size, (len(out), size)
    return bytes(out)


def read(path):
    """Positions, colours and viewpoint of a cloud."""
    header, data = path.read_bytes().split(b"DATA binary_compressed\n")
    entries = dict(line.split(" ", 1) for line in header.decode().splitlines() if line[0] != "#")
    assert (entries["FIELDS"], entries["SIZE"], entries["COUNT"]) == ("x y z rgb", "4 4 4 4", "1 1 1 1"), entries
    packed, size = struct.unpack("<II", data[:8])
    columns = np.frombuffer(decompressed(data[8 : 8 + packed], size), "<u4").reshape(4, -1)
    xyz = columns[:3].view("<f4").T
    rgb = np.stack([columns[3] >> shift & 255 for shift in (16, 8, 0)], axis=1)
    finite = np.isfinite(xyz).all(axis=1)
    return xyz[finite], rgb[finite], np.array(entries["VIEWPOINT"].split()[:3], float)


def squared_distances(points, others):
    """Of each of the points to each of the others."""
    lengths = [(positions**2).sum(axis=1) for positions in (points, others)]
    return lengths[0][:, None] + lengths[1] - 2 * points @ others.T


def voxel_centroids(xyz):
    """Of the occupied voxels of a grid through the origin; in single precision, as all positions."""
    cells = np.floor(xyz * np.float32(1 / np.float32(GRID)))
    _, cell, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    cell = cell.ravel()
    sums = [np.bincount(cell, axis) for axis in xyz.T.astype(float)]
    return (np.stack(sums, axis=1) / count[:, None]).astype(np.float32).astype(float)


def normals(points, xyz, viewpoint):
    """Of planes through all points of a cloud within the radius, towards the viewpoint; NaN where there are under 3."""
    centre = xyz.mean(axis=0)
    x, y, z = (xyz - centre).T
    moments = np.stack([np.ones_like(x), x, y, z, x * x, x * y, x * z, y * y, y * z, z * z], axis=1)
    order = np.argsort(x)
    x, xyz, moments = x[order], xyz[order], moments[order]
    found = np.full(points.shape, np.nan)
    across = np.argsort(points[:, 0])
    for some in np.array_split(across, len(points) // 100 + 1):  # only clouds' points of about the same x
        ends = points[some[[0, -1]], 0] - centre[0] + [-1.01 * NORMALS, 1.01 * NORMALS]
        begin, end = np.searchsorted(x, ends)
        near = squared_distances(points[some], xyz[begin:end]) <= NORMALS**2
        sums = near @ moments[begin:end]
        some, sums = some[sums[:, 0] >= 3], sums[sums[:, 0] >= 3]
        means = sums / sums[:, :1]
        squares = means[:, [4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(-1, 3, 3)
        covariance = squares - means[:, 1:4, None] * means[:, None, 1:4]
        normal = np.linalg.eigh(covariance).eigenvectors[:, :, 0]
        away = ((viewpoint - points[some]) * normal).sum(axis=1) < 0
        found[some] = np.where(away[:, None], -normal, normal)
    return found


def lab(rgb):
    """L/100, a/120, b/120 of sRGB under D65, with the table of 4000 steps that PCL's SHOT with colour has."""
    c = np.arange(256) / 255
    linear = np.where(c > 0.04045, ((c + 0.055) / 1.055) ** 2.4, c / 12.92)[rgb]
    to_xyz = [[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]]
    t = np.arange(4000) / 4000
    table = np.where(t > 0.008856, np.cbrt(t), 7.87 * t + 16 / 116)
    steps = linear @ np.array(to_xyz).T / [0.95047, 1, 1.08883] * 4000
    x, y, z = table[np.minimum(steps.astype(int), 3999)].T
    a, b = np.clip([500 * (x - y), 200 * (y - z)], -120, 120) / 120
    return np.minimum(116 * y - 16, 100) / 100, a, b


def rows(xyz, rgb, viewpoint):
    """One row of shares for each keypoint that has a normal."""
    xyz = xyz.astype(float)
    keypoints = voxel_centroids(xyz.astype(np.float32))
    of_keypoints, of_points = (normals(points, xyz, viewpoint) for points in (keypoints, xyz))
    has = np.isfinite(of_keypoints[:, 0])
    keypoints, of_keypoints = keypoints[has], of_keypoints[has]

    near = squared_distances(keypoints, xyz) <= RADIUS**2
    row, point = np.nonzero(near & np.isfinite(of_points[:, 0]))
    line = xyz[point] - keypoints[row]
    distance = np.linalg.norm(line, axis=1)
    u, normal = of_keypoints[row], of_points[point]  # Darboux frame u v w
    v = np.cross(line, u)
    length = np.linalg.norm(v, axis=1)
    framed = length > 0
    row, point, distance, line, u, normal, v, length = (
        values[framed] for values in (row, point, distance, line, u, normal, v, length)
    )
    v /= length[:, None]
    dot = lambda a, b: (a * b).sum(axis=1)
    f1 = np.arctan2(dot(np.cross(u, v), normal), dot(u, normal))
    a2 = np.arccos(np.clip(dot(v, normal), -1, 1))
    a3 = np.arccos(np.clip(dot(u, line) / distance, -1, 1))

    shell = np.ceil(distance / (RADIUS / SHELLS)).astype(int) - 1  # on a bound: the inner one
    shell = np.minimum(shell, SHELLS - 1)
    counts = np.zeros((len(keypoints), SHELLS, len(RANGES), BINS))
    for feature, (values, (low, high)) in enumerate(zip([f1, a2, a3, *(c[point] for c in lab(rgb))], RANGES)):
        bins = np.clip(np.floor((values - low) / (high - low) * BINS), 0, BINS - 1).astype(int)
        into = np.ravel_multi_index((row, shell, feature, bins), counts.shape)
        counts += np.bincount(into, minlength=counts.size).reshape(counts.shape)
    shares = counts / np.maximum(counts.sum(axis=3, keepdims=True), 1)
    return shares.reshape(len(keypoints), -1)


def signature(path):
    """Centroid and deviation of a cloud's rows; None if it has too few points or no rows."""
    xyz, rgb, viewpoint = read(path)
    if len(xyz) < LEAST_POINTS or not len(described := rows(xyz, rgb, viewpoint)):
        return None
    deviation = described.std(axis=0, ddof=1) if len(described) > 1 else np.zeros(described.shape[1])
    return np.concatenate([described.mean(axis=0), deviation])


def chi_squared(one, others):
    """Of centroids plus of deviations: one sum over both."""
    sums = one + others
    return ((one - others) ** 2 / np.where(sums > 0, 2 * sums, 1)).sum(axis=1)


def main():
    arguments = argparse.ArgumentParser(usage=__doc__)
    arguments.add_argument("data", type=pathlib.Path)
    arguments.add_argument("query")
    arguments.add_argument("database", nargs="+")
    arguments.add_argument("--out", type=argparse.FileType("w"), default=sys.stdout)
    asked = arguments.parse_args()

    def described(lists):
        paths = [path for name in lists for path in (asked.data / name).read_text().split()]
        found = ((path, signature(asked.data / path)) for path in paths)
        return {path: values for path, values in found if values is not None}

    database = described(asked.database)
    paths, values = list(database), np.array(list(database.values()))
    for query, one in described([asked.query]).items():
        distances = chi_squared(one, values)
        nearest = distances.argmin()
        print(query, paths[nearest], distances[nearest], file=asked.out)


if __name__ == "__main__":
    main()
