"""Has other programs write clouds, and compares what Descry reads with what they were given.

Usage: round_trips.py OUT CLOUD...

Needs the package descry, numpy and plyfile. Open3D, PCL's tools (Debian: pcl-tools) and CloudCompare write where they
are installed; a line names those that are not. OUT is a new folder for the files.

Prints, of each writer and format over all clouds: how far positions and colours of what Descry reads are from the
original, whether the camera is where it was, and how far the signatures of experiments/descriptors/paper.toml and
pfhrgb.toml are apart. Fails if a file is refused that need not be, or has another
number of points.
"""

import importlib.metadata
import os
import pathlib
import shutil
import subprocess
import sys

import descry
import numpy as np

EXPERIMENTS = pathlib.Path(__file__).resolve().parents[2] / "experiments"
DESCRIPTORS = [EXPERIMENTS / f"descriptors/{name}.toml" for name in ("paper", "pfhrgb")]
SIGNATURES = {}
#: PCL 1.13 writes a field rgb of integers as one integer, under a header that says three bytes.
REFUSED = {("PCL", f"PLY {encoding}, rgb as U4") for encoding in ("ascii", "binary")}
#: Where the camera is put, to see who keeps it: at numbers that are short in text.
CAMERA = (0.125, -0.25, -0.5)


def run(*command, **options):
    done = subprocess.run([str(part) for part in command], check=False, capture_output=True, text=True, **options)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout


def write_pcd(path, cloud, real, colour, packed):
    """The cloud as those programs get it that read files: binary PCD, the field ``colour`` of type F or U."""
    table = np.empty(len(cloud.xyz), [(axis, real) for axis in "xyz"] + [("rgb", "<u4")])
    for column, axis in enumerate("xyz"):
        table[axis] = cloud.xyz[:, column]
    red, green, blue = cloud.rgb.astype("<u4").T
    table["rgb"] = red << 16 | green << 8 | blue
    size, count = np.dtype(real).itemsize, len(table)
    camera = " ".join(map(str, CAMERA))
    header = (
        f"VERSION 0.7\nFIELDS x y z {colour}\nSIZE {size} {size} {size} 4\nTYPE F F F {packed}\nCOUNT 1 1 1 1\n"
        f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT {camera} 1 0 0 0\nPOINTS {count}\nDATA binary\n"
    )
    path.write_bytes(header.encode() + table.tobytes())


def write_ply(path, cloud, real, order):
    """By plyfile; ``order`` is the byte order, or empty for text."""
    from plyfile import PlyData, PlyElement

    names = [*"xyz", "red", "green", "blue"]
    table = np.empty(len(cloud.xyz), [(name, real if name in "xyz" else "u1") for name in names])
    for name, column in zip(names, [*cloud.xyz.T, *cloud.rgb.T]):
        table[name] = column
    PlyData([PlyElement.describe(table, "vertex")], text=not order, byte_order=order or "=").write(str(path))


def plyfile():
    for real, reals in (("f4", "float"), ("f8", "double")):
        for order, name in (("", "ascii"), ("<", "little endian"), (">", "big endian")):
            yield f"PLY {name}, {reals}", lambda cloud, given, path, args=(real, order): write_ply(path, cloud, *args)


#: Of both kinds of clouds that Open3D has: what asks for the encoding.
OF_OPEN3D = {
    "PLY ascii": {"write_ascii": True},
    "PLY binary": {},
    "PCD ascii": {"write_ascii": True},
    "PCD binary": {},
    "PCD binary_compressed": {"compressed": True},
}


def open3d():
    import open3d

    def legacy(cloud):
        made = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud.xyz.astype("f8")))
        made.colors = open3d.utility.Vector3dVector(cloud.rgb / 255)
        return made

    def tensor(cloud):
        made = open3d.t.geometry.PointCloud(open3d.core.Tensor(cloud.xyz))
        made.point.colors = open3d.core.Tensor(cloud.rgb)
        return made

    for module, make, name in ((open3d, legacy, "geometry"), (open3d.t, tensor, "t.geometry")):
        for encoding, options in OF_OPEN3D.items():

            def write(cloud, given, path, module=module, make=make, options=options):
                assert module.io.write_point_cloud(str(path), make(cloud), **options), path

            yield f"{encoding}, {name}", write


def pcl():
    for kind, name in (("float", "float"), ("double", "double"), ("rgba", "rgba"), ("u4", "rgb as U4")):
        for number, encoding in enumerate(("ascii", "binary")):
            options = ("-format", number, "-use_camera", 1)
            yield f"PLY {encoding}, {name}", lambda _, given, path, kind=kind, options=options: run(
                "pcl_pcd2ply", *options, given[kind], path
            )
    for number, name in enumerate(("ascii", "binary", "binary_compressed")):
        yield f"PCD {name}", lambda _, given, path, number=number: run(
            "pcl_convert_pcd_ascii_binary", given["float"], path, number
        )
    yield "PCD ascii, 9 digits", lambda _, given, path: run("pcl_convert_pcd_ascii_binary", given["float"], path, 0, 9)


def cloudcompare():
    for name in ("ASCII", "BINARY_LE", "BINARY_BE"):

        def write(_, given, path, name=name):
            options = ("-AUTO_SAVE", "OFF", "-C_EXPORT_FMT", "PLY", "-PLY_EXPORT_FMT", name)
            run(
                *("CloudCompare", "-SILENT", "-O", given["ply"], *options, "-SAVE_CLOUDS", "FILE", path),
                env=dict(os.environ, QT_QPA_PLATFORM="offscreen", HOME=str(path.parent)),
            )

        yield f"PLY {name}", write


def packaged(name):
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def installed(program, package):
    return run("dpkg-query", "-W", "-f", "${Version}", package) if shutil.which(program) else None


WRITERS = [
    ("plyfile", plyfile, lambda: packaged("plyfile")),
    ("Open3D", open3d, lambda: packaged("open3d")),
    ("PCL", pcl, lambda: installed("pcl_pcd2ply", "pcl-tools")),
    ("CloudCompare", cloudcompare, lambda: installed("CloudCompare", "cloudcompare")),
]


def signature(cloud, descriptor, viewpoint):
    """Computed once of equal clouds."""
    key = cloud.xyz.tobytes(), cloud.rgb.tobytes(), descriptor, viewpoint
    if key not in SIGNATURES:
        SIGNATURES[key] = descry.describe(cloud.xyz, cloud.rgb, descriptor, viewpoint)
    return SIGNATURES[key]


def off(distance, unit=""):
    return f"{distance:.0e}{unit}" if distance else "equal"


class Row:
    """How far what Descry reads is from the original, over all clouds."""

    def __init__(self):
        self.positions, self.colours, self.camera, self.signatures = 0.0, 0, True, [0.0] * len(DESCRIPTORS)

    def add(self, original, path):
        read = descry.read_cloud(path)
        assert read.xyz.shape == original.xyz.shape, (read.xyz.shape, original.xyz.shape)
        self.positions = max(self.positions, np.abs(read.xyz.astype(float) - original.xyz).max())
        self.colours = max(self.colours, np.abs(read.rgb.astype(int) - original.rgb).max())
        self.camera &= read.viewpoint == CAMERA
        for index, descriptor in enumerate(DESCRIPTORS):
            # From where the camera is read to be: the column of its own says whether that is so.
            of = [signature(cloud, descriptor, read.viewpoint) for cloud in (original, read)]
            self.signatures[index] = max(self.signatures[index], float(np.abs(of[0] - of[1]).max()))

    def __str__(self):
        camera = "kept" if self.camera else "lost"
        return " | ".join([off(self.positions, " m"), off(self.colours), camera, *map(off, self.signatures)])


def main():
    out, paths = pathlib.Path(sys.argv[1]).resolve(), sys.argv[2:]
    out.mkdir(parents=True)
    assert paths, "no clouds"
    originals = []
    for number, path in enumerate(paths):
        cloud = descry.read_cloud(path)
        given = {"ply": out / f"given-{number}.ply"}
        write_ply(given["ply"], cloud, "f4", "<")
        for kind, *fields in (
            ("float", "<f4", "rgb", "F"),
            ("double", "<f8", "rgb", "F"),
            ("rgba", "<f4", "rgba", "U"),
            ("u4", "<f4", "rgb", "U"),
        ):
            given[kind] = out / f"given-{number}-{kind}.pcd"
            write_pcd(given[kind], cloud, *fields)
        originals.append((cloud, given))
    print(f"{len(paths)} clouds of {sum(len(cloud.xyz) for cloud, _ in originals)} points\n")
    print("| writer | file | positions | colours | camera | paper | pfhrgb |\n|---|---|---|---|---|---|---|")
    missing, refused = [], set()
    for name, formats, version in WRITERS:
        if not (found := version()):
            missing.append(name)
            continue
        for kind, write in formats():
            row = Row()
            for number, (cloud, given) in enumerate(originals):
                ending = kind[:3].lower()
                path = out / f"{name}-{kind.replace(' ', '-').replace(',', '')}-{number}.{ending}"
                write(cloud, given, path)
                try:
                    row.add(cloud, path)
                except descry.Error as error:
                    refused.add((name, kind))
                    row = f"refused: {error.what.removeprefix(f'{path}: ')}"
                    break
            print(f"| {name} {found} | {kind} | {row} |", flush=True)
    if missing:
        print(f"\nnot installed: {', '.join(missing)}")
    assert refused == {one for one in REFUSED if one[0] not in missing}, refused


if __name__ == "__main__":
    main()
