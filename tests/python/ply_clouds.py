"""Writes a data set again as PLY files, by plyfile, without any code of Descry.

Usage: ply_clouds.py DATA OUT [--open3d], where DATA is as `coordinator synth` writes it; needs numpy and plyfile, with
--open3d Open3D instead of plyfile.

Every cloud is written below the same name with the ending .ply, the lists with these names. plyfile's clouds take turns
in what PLY files can be: text, little and big endian; float and double; red and diffuse_red; uchar and ushort; faces in
front of or behind the points. Open3D's are binary with positions in double: its text has six digits, which are other points.
The viewpoint must be the origin, since neither writes one.
"""

import argparse
import pathlib

import numpy as np

from cospair import read


def by_plyfile(number, xyz, rgb, path):
    """Writes the cloud in the variant of that number."""
    from plyfile import PlyData, PlyElement

    real = ("f4", "f8")[number // 3 % 2]
    prefix, channel = [("", "u1"), ("diffuse_", "u1"), ("", "u2"), ("diffuse_", "f4"), ("", "f8")][number % 5]
    names = [prefix + name for name in ("red", "green", "blue")]
    table = np.empty(len(xyz), [("quality", "f4"), *((name, channel) for name in names), *((axis, real) for axis in "zyx")])
    table["quality"] = 0.5
    for column, axis in enumerate("xyz"):
        table[axis] = xyz[:, column]
    for column, name in enumerate(names):
        table[name] = {"u1": rgb, "u2": rgb.astype("u2") * 257}.get(channel, rgb / 255)[:, column]
    faces = np.empty(2, [("vertex_indices", object)])
    faces["vertex_indices"] = [np.array([0, 1, 2], "i4"), np.array([2, 1, 0, 3], "i4")]
    elements = [PlyElement.describe(table, "vertex"), PlyElement.describe(faces, "face")]
    data = PlyData(elements[:: 1 if number % 2 else -1], text=number % 3 == 0, comments=["made by plyfile"])
    data.byte_order = "><"[number % 3 == 1] if number % 3 else "="
    data.write(str(path))


def by_open3d(_number, xyz, rgb, path):
    """Writes the cloud as Open3D does by itself."""
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(xyz.astype("f8")))
    cloud.colors = open3d.utility.Vector3dVector(rgb / 255)
    assert open3d.io.write_point_cloud(str(path), cloud)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--open3d", action="store_true")
    args = parser.parse_args()
    write = by_open3d if args.open3d else by_plyfile
    for number, source in enumerate(sorted(args.data.rglob("*.pcd"))):
        xyz, rgb, viewpoint = read(source)
        assert not viewpoint.any(), f"{source}: a viewpoint at the origin is needed, got {viewpoint}"
        target = (args.out / source.relative_to(args.data)).with_suffix(".ply")
        target.parent.mkdir(parents=True, exist_ok=True)
        write(number, xyz, rgb, target)
    for source in args.data.glob("*.txt"):
        (args.out / source.name).write_text(source.read_text().replace(".pcd", ".ply"))


if __name__ == "__main__":
    main()
